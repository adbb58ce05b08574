rule analyse:
    input:
        study="<results>/{study}/study.yaml",
        prepared="<results>/{study}/prepared",
        posteriors=posteriors_of,
        modules=modules(
            "analyses/*.py",
            "pipeline/analyse.py",
            "fitted.py",
            "passes.py",
            "roughness.py",
            "prediction/errors.py",
            "posteriors/summary.py",
            "influence.py",
            "sensitivity.py",
        ),
    output:
        directory("<results>/{study}/analyses"),
    log:
        "<results>/{study}/logs/analyse.log",
    threads: 1
    params:
        results=subpath(output[0], parent=True),
    shell:
        "logged {log:q} deabayes analyse {params.results:q} -o {output:q}"
