rule study:
    output:
        "<results>/{study}/study.yaml",
    log:
        "<results>/{study}/logs/study.log",
    params:
        settings=settings_of,
    shell:
        "printf '%s\n' {params.settings:q} > {output:q} 2> {log:q}"


rule prepare:
    input:
        study="<results>/{study}/study.yaml",
        raw=raw_files,
        code=code_of("records.preparation", "records.folder"),
    output:
        directory("<results>/{study}/prepared"),
    log:
        "<results>/{study}/logs/prepare.log",
    threads: 1
    params:
        sums=raw_sums,
    shell:
        "logged {log:q} deabayes prepare {input.study:q} -o {output:q}"
