# The best fit of every candidate in seconds; nothing depends on it. Records are prepared before
# other jobs run, so that previews are the first results.
rule preview:
    input:
        study="<results>/{study}/study.yaml",
        records=prepared_of,
        model=own_model,
        prior=inherited_posterior,
    output:
        directory("<results>/{study}/preview"),
    log:
        "<results>/{study}/logs/preview.log",
    priority: 90
    threads: 1
    params:
        code=digest_of("pipeline.preview"),
        prepared=prepared_folder,
    shell:
        "logged {log:q} deabayes fit {input.study:q} --preview --prepared {params.prepared:q} -o {output:q}"
