rule score:
    input:
        posterior="<results>/{study}/{candidate}/posterior.nc",
        prepared="<results>/{study}/prepared",
        code=code_of("comparison.scoring", "comparison.left_out"),
    output:
        "<results>/{study}/{candidate}/scores.json",
    log:
        "<results>/{study}/{candidate}/logs/score.log",
    threads: 1
    shell:
        "logged {log:q} deabayes score {input.posterior:q} --prepared {input.prepared:q} -o {output:q}"


# Only for studies with `evidence_check: nested`; takes minutes per candidate.
rule nested:
    input:
        posterior="<results>/{study}/{candidate}/posterior.nc",
        prepared="<results>/{study}/prepared",
        code=code_of("comparison.nested"),
    output:
        "<results>/{study}/{candidate}/nested.json",
    log:
        "<results>/{study}/{candidate}/logs/nested.log",
    threads: 1
    shell:
        "logged {log:q} deabayes nested {input.posterior:q} --prepared {input.prepared:q} -o {output:q}"


rule compare:
    input:
        posteriors=posteriors_of,
        scores=scores_of,
        checks=checks_of,
        prepared="<results>/{study}/prepared",
        code=code_of("comparison.ranking"),
    output:
        report(
            "<results>/{study}/comparison.csv",
            caption="../report/comparison.rst",
            category="Model order",
        ),
    log:
        "<results>/{study}/logs/compare.log",
    threads: 1
    shell:
        "logged {log:q} deabayes compare {input.posteriors:q} --prepared {input.prepared:q} -o {output:q}"


rule further_experiments:
    input:
        comparison="<results>/{study}/comparison.csv",
        posteriors=posteriors_of,
        prepared="<results>/{study}/prepared",
        code=code_of("comparison.further", "posteriors.fitted"),
    output:
        report(
            "<results>/{study}/further_experiments.csv",
            caption="../report/further_experiments.rst",
            category="Model order",
        ),
    log:
        "<results>/{study}/logs/further_experiments.log",
    threads: 1
    params:
        results=subpath(output[0], parent=True),
        asked=further_experiments_of,
    shell:
        "logged {log:q} deabayes further {params.results:q} --asked {params.asked:q} -o {output:q}"
