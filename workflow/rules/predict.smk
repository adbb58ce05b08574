rule predict:
    input:
        posterior="<results>/{study}/{candidate}/posterior.nc",
        prepared="<results>/{study}/prepared",
        code=code_of("posteriors.fitted", "prediction.errors"),
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
    shell:
        "logged {log:q} deabayes predict {input.posterior:q} --prepared {input.prepared:q} -o {output.predictions:q}"
        " --errors {output.errors:q}"
