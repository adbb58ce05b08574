rule predict:
    input:
        posterior="<results>/{study}/{candidate}/posterior.nc",
        records=prepared_of,
    output:
        predictions=directory("<results>/{study}/{candidate}/predictions"),
        errors=report(
            "<results>/{study}/{candidate}/errors.csv",
            caption="../report/errors.rst",
            category="Errors",
        ),
    log:
        "<results>/{study}/{candidate}/logs/predict.log",
    threads: 1
    params:
        code=digest_of("posteriors.fitted", "prediction.errors"),
        prepared=prepared_folder,
    shell:
        "logged {log:q} deabayes predict {input.posterior:q} --prepared {params.prepared:q} -o {output.predictions:q}"
        " --errors {output.errors:q}"
