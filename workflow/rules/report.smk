rule figures:
    input:
        study="<results>/{study}/study.yaml",
        comparison="<results>/{study}/comparison.csv",
        further="<results>/{study}/further_experiments.csv",
        errors=of_candidates("errors.csv"),
        analyses="<results>/{study}/analyses",
    output:
        directory("<results>/{study}/figures"),
    log:
        "<results>/{study}/logs/figures.log",
    threads: 1
    params:
        code=digest_of("figures", "papers"),
        results=subpath(output[0], parent=True),
    shell:
        "logged {log:q} deabayes figures {params.results:q} -o {output:q}"


rule report:
    input:
        figures=expand("<results>/{study}/figures", study=STUDIES)
        + expand("<results>/populations/{population}/figures", population=POPULATIONS),
    output:
        page=report(
            "<results>/report/index.html",
            caption="../report/page.rst",
            category="Report",
        ),
        tables=directory("<results>/report/tables"),
    log:
        "<results>/logs/report.log",
    threads: 2
    params:
        code=digest_of("report"),
        folders=study_folders,
        left_out=left_out_options(),
    shell:
        "logged {log:q} deabayes report {params.folders:q} -o {output.page:q} --tables {output.tables:q}"
        " {params.left_out:q}"
