rule analyse:
    input:
        study="<results>/{study}/study.yaml",
        records=prepared_of,
        posteriors=of_candidates("posterior.nc"),
    output:
        directory("<results>/{study}/analyses"),
    log:
        "<results>/{study}/logs/analyse.log",
    threads: 1
    params:
        code=digest_of("papers"),
        results=subpath(output[0], parent=True),
    shell:
        "logged {log:q} deabayes analyse {params.results:q} -o {output:q}"
