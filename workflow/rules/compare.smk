rule score:
    input:
        posterior="<results>/{study}/{candidate}/posterior.nc",
        prepared="<results>/{study}/prepared",
        modules=modules("scoring.py"),
    output:
        "<results>/{study}/{candidate}/scores.json",
    log:
        "<results>/{study}/{candidate}/logs/score.log",
    threads: 1
    shell:
        "logged {log} deabayes score {input.posterior} --prepared {input.prepared} -o {output}"


rule compare:
    input:
        posteriors=posteriors_of,
        scores=scores_of,
        prepared="<results>/{study}/prepared",
        modules=modules("comparison.py", "ranking.py"),
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
        "logged {log} deabayes compare {input.posteriors} --prepared {input.prepared} -o {output}"
