CODE = "<results>/{study}/logs/code"
COMPILED = "<results>/{study}/logs/compiled"
FITTED = [
    "<results>/{study}/{candidate}/posterior.nc",
    "<results>/{study}/{candidate}/summary.csv",
]


# What a fit is made of and what it runs, as one file. study.yaml and prepared/ also change with
# other candidates and held-out records: where there is a posterior of this code, they and
# `compiled` are ancient to it. An edit must reach it through the output of a job: in a run that
# makes one of these again, Snakemake looks at nothing else of it.
rule code:
    input:
        code=code_of("pipeline.fit"),
        own=own_model,
        prior=posterior_from_outside,
    output:
        CODE,
    log:
        "<results>/{study}/logs/code.log",
    params:
        made_of=made_of,
    shell:
        "{{ echo {params.made_of:q}; cksum {input:q}; }} > {output:q} 2> {log:q}"


rule compile:
    input:
        study=until_there("<results>/{study}/study.yaml", COMPILED),
        prepared=until_there("<results>/{study}/prepared", COMPILED),
        code=CODE,
    output:
        touch(COMPILED),
    log:
        "<results>/{study}/logs/compile.log",
    threads: 1
    shell:
        "logged {log:q} deabayes compile {input.study:q}"


rule fit:
    input:
        study=until_there("<results>/{study}/study.yaml", *FITTED),
        prepared=until_there("<results>/{study}/prepared", *FITTED),
        prior=inherited_posterior,
        compiled=until_there(COMPILED, *FITTED),
        code=CODE,
    output:
        posterior=FITTED[0],
        summary=FITTED[1],
    log:
        "<results>/{study}/{candidate}/logs/fit.log",
    threads: 1
    shell:
        "logged {log:q} deabayes fit {input.study:q} {wildcards.candidate:q} --prepared {input.prepared:q}"
        " -o {output.posterior:q} --summary {output.summary:q}"
