MODEL = modules(
    "experiment.py",
    "parameter.py",
    "passes.py",
    "distributions/*.py",
    "instruments.py",
    "prior/*.py",
    "posterior.py",
    "posteriors/inheritance.py",
    "record_noise.py",
    "residual_scale.py",
    "electrostatics.py",
    "integrate/*.py",
    "springs/*.py",
    "systems/*.py",
    "own_models/*.py",
    "noise/*.py",
)
POOLED = modules("sampling/pooling.py", "sampling/extension.py", "sampling/refit.py")
SAMPLING = [path for path in modules("sampling/*.py") if path not in POOLED]
POOLING = POOLED + modules(
    "prediction/noise_origin.py",
    "pareto.py",
    "posteriors/*.py",
    "prediction/rapidity.py",
)


rule compile:
    input:
        studies=expand("<results>/{study}/study.yaml", study=STUDIES),
        prepared=expand("<results>/{study}/prepared", study=STUDIES),
        modules=MODEL,
        own=own_models(),
    output:
        touch("<results>/logs/compiled"),
    log:
        "<results>/logs/compile.log",
    threads: 1
    shell:
        "logged {log:q} deabayes compile {input.studies:q}"


# What a fit runs, as one file. An edit must reach `fit` through the output of a job: in a run
# that compiles, Snakemake looks at nothing else of it, because `compiled` is ancient.
rule code:
    input:
        modules=MODEL + SAMPLING,
        own=own_model,
    output:
        "<results>/{study}/logs/code",
    log:
        "<results>/{study}/logs/code.log",
    shell:
        "cksum {input:q} > {output:q} 2> {log:q}"


rule fit:
    input:
        study="<results>/{study}/study.yaml",
        prepared="<results>/{study}/prepared",
        prior=inherited_posterior,
        compiled=ancient("<results>/logs/compiled"),
        code="<results>/{study}/logs/code",
    output:
        "<results>/{study}/{candidate}/ensembles/{ensemble}.nc",
    log:
        "<results>/{study}/{candidate}/logs/ensemble_{ensemble}.log",
    threads: 1
    shell:
        "logged {log:q} deabayes fit {input.study:q} {wildcards.candidate:q} --prepared {input.prepared:q}"
        " --ensemble {wildcards.ensemble} -o {output:q}"


rule pool:
    input:
        study="<results>/{study}/study.yaml",
        prepared="<results>/{study}/prepared",
        ensembles=ensembles_of,
        modules=POOLING,
    output:
        posterior="<results>/{study}/{candidate}/posterior.nc",
        summary="<results>/{study}/{candidate}/summary.csv",
    log:
        "<results>/{study}/{candidate}/logs/pool.log",
    threads: pooling_threads
    shell:
        "logged {log:q} deabayes pool {input.study:q} {wildcards.candidate:q} {input.ensembles:q}"
        " --prepared {input.prepared:q} -o {output.posterior:q} --summary {output.summary:q}"
        " --processes {threads}"
