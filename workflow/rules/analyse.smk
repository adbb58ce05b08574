rule analyse:
    input:
        study="<results>/{study}/study.yaml",
        prepared="<results>/{study}/prepared",
        posteriors=posteriors_of,
        code=code_of("papers"),
    output:
        directory("<results>/{study}/analyses"),
    log:
        "<results>/{study}/logs/analyse.log",
    threads: 1
    params:
        results=subpath(output[0], parent=True),
    shell:
        "logged {log:q} deabayes analyse {params.results:q} -o {output:q}"
