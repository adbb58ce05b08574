# Writes the study's settings and checks them with its tables and records. No fit waits for this
# job: it also runs again for other candidates and for held-out records.
rule check:
    output:
        "<results>/{study}/study.yaml",
    log:
        "<results>/{study}/logs/check.log",
    priority: 100
    threads: 1
    params:
        settings=settings_of_study,
        content=content_of_folder,
    shell:
        "printf '%s\n' {params.settings:q} > {output:q}; logged {log:q} deabayes check {output:q}"


rule prepare:
    output:
        settings="<results>/{study}/prepared/{record}.yaml",
        record="<results>/{study}/prepared/{record}.nc",
    log:
        "<results>/{study}/logs/prepare/{record}.log",
    priority: 80
    threads: 1
    params:
        settings=settings_of_record,
        content=content_of_record,
        code=digest_of("pipeline.prepare"),
        folder=subpath(output.record, parent=True),
    shell:
        "printf '%s\n' {params.settings:q} > {output.settings:q};"
        " logged {log:q} deabayes prepare {output.settings:q} --record {wildcards.record:q}"
        " -o {params.folder:q}"
