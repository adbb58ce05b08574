ENSEMBLE = "<results>/{study}/{candidate}/ensembles/{ensemble}.nc"
POSTERIOR = "<results>/{study}/{candidate}/posterior.nc"
MODEL = modules(
    "experiment.py",
    "parameter.py",
    "passes.py",
    "roughness.py",
    "distributions/*.py",
    "instruments.py",
    "prior/*.py",
    "posterior.py",
    "predict_with.py",
    "posteriors/counted_records.py",
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
    "checks/overruled.py",
    "checks/prior_scale.py",
    "prediction/noise_origin.py",
    "pareto.py",
    "posteriors/*.py",
    "prediction/rapidity.py",
)


rule compile:
    input:
        studies=until_compiled("<results>/{study}/study.yaml"),
        prepared=until_compiled("<results>/{study}/prepared"),
        modules=MODEL,
        own=own_models(),
    output:
        touch("<results>/logs/compiled"),
    log:
        "<results>/logs/compile.log",
    threads: 1
    shell:
        "logged {log:q} deabayes compile {input.studies:q}"


# What a fit is made of and what it runs, as one file. study.yaml and prepared/ also change with
# other candidates and held-out records: once there is an ensemble, they and `compiled` are ancient
# to it. An edit must reach it through the output of a job: in a run that makes one of these
# again, Snakemake looks at nothing else of it.
rule code:
    input:
        modules=PREPARATION + MODEL + SAMPLING,
        own=own_model,
        prior=posterior_from_outside,
    output:
        "<results>/{study}/logs/code",
    log:
        "<results>/{study}/logs/code.log",
    params:
        made_of=made_of,
    shell:
        "{{ echo {params.made_of:q}; cksum {input:q}; }} > {output:q} 2> {log:q}"


rule fit:
    input:
        study=until_there("<results>/{study}/study.yaml", ENSEMBLE),
        prepared=until_there("<results>/{study}/prepared", ENSEMBLE),
        prior=inherited_posterior,
        compiled=until_there("<results>/logs/compiled", ENSEMBLE),
        code="<results>/{study}/logs/code",
    output:
        ENSEMBLE,
    log:
        "<results>/{study}/{candidate}/logs/ensemble_{ensemble}.log",
    threads: 1
    shell:
        "logged {log:q} deabayes fit {input.study:q} {wildcards.candidate:q} --prepared {input.prepared:q}"
        " --ensemble {wildcards.ensemble} -o {output:q}"


rule pool:
    input:
        study=until_there("<results>/{study}/study.yaml", POSTERIOR),
        prepared=until_there("<results>/{study}/prepared", POSTERIOR),
        ensembles=ensembles_of,
        modules=POOLING,
    output:
        posterior=POSTERIOR,
        summary="<results>/{study}/{candidate}/summary.csv",
    log:
        "<results>/{study}/{candidate}/logs/pool.log",
    threads: pooling_threads
    shell:
        "logged {log:q} deabayes pool {input.study:q} {wildcards.candidate:q} {input.ensembles:q}"
        " --prepared {input.prepared:q} -o {output.posterior:q} --summary {output.summary:q}"
        " --processes {threads}"
