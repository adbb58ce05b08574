rule predict:
    input:
        posterior="<results>/{study}/{candidate}/posterior.nc",
        prepared="<results>/{study}/prepared",
        modules=modules(
            "calibrated.py",
            "prediction.py",
            "noise_origin.py",
            "rapidity.py",
            "fitted.py",
            "errors.py",
            "errors_table.py",
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
        "logged {log} deabayes predict {input.posterior} --prepared {input.prepared} -o {output.predictions}"
        " --errors {output.errors}"
