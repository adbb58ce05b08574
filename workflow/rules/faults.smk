# A study with faults is left out.
# This job fails, so that the run does; its output is never made.
rule faults:
    output:
        "<results>/{study}/faults",
    log:
        "<results>/{study}/logs/faults.log",
    wildcard_constraints:
        study=any_of(FAULTS),
    params:
        faults=lambda wildcards: "\n".join(FAULTS[wildcards.study]),
    shell:
        "printf '%s\n' {params.faults:q} > {log:q}; exit 1"
