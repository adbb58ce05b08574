rule predict:
    input:
        posterior="<results>/{study}/{candidate}/posterior.nc",
        prepared="<results>/{study}/prepared",
        modules=modules(
            "prediction/calibrated.py",
            "prediction/bands.py",
            "prediction/mixture_bands.py",
            "prediction/transforms.py",
            "prediction/outcomes.py",
            "prediction/noise_origin.py",
            "prediction/rapidity.py",
            "fitted.py",
            "prediction/errors.py",
            "prediction/errors_table.py",
        ),
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
