rule score:
    input:
        posterior="<results>/{study}/{candidate}/posterior.nc",
        records=prepared_of,
    output:
        "<results>/{study}/{candidate}/scores.json",
    log:
        "<results>/{study}/{candidate}/logs/score.log",
    threads: 1
    params:
        code=digest_of("comparison.evidence"),
        prepared=prepared_folder,
    shell:
        "logged {log:q} deabayes score {input.posterior:q} --prepared {params.prepared:q} -o {output:q}"


# Only for studies with `evidence_check: nested`; takes minutes per candidate.
rule nested:
    input:
        posterior="<results>/{study}/{candidate}/posterior.nc",
        records=prepared_of,
    output:
        "<results>/{study}/{candidate}/nested.json",
    log:
        "<results>/{study}/{candidate}/logs/nested.log",
    threads: 1
    params:
        code=digest_of("comparison.nested"),
        prepared=prepared_folder,
    shell:
        "logged {log:q} deabayes nested {input.posterior:q} --prepared {params.prepared:q} -o {output:q}"


rule compare:
    input:
        study="<results>/{study}/study.yaml",
        posteriors=of_candidates("posterior.nc"),
        scores=of_candidates("scores.json"),
        checks=checks_of,
        records=prepared_of,
    output:
        report(
            "<results>/{study}/comparison.csv",
            caption="../report/comparison.rst",
            category="Model order",
        ),
    log:
        "<results>/{study}/logs/compare.log",
    threads: 1
    params:
        code=digest_of("comparison.ranking"),
        prepared=prepared_folder,
    shell:
        "logged {log:q} deabayes compare {input.posteriors:q} --prepared {params.prepared:q} -o {output:q}"


rule further_experiments:
    input:
        comparison="<results>/{study}/comparison.csv",
        posteriors=of_candidates("posterior.nc"),
        records=prepared_of,
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
        code=digest_of("comparison.further", "posteriors.fitted"),
        results=subpath(output[0], parent=True),
        asked=further_experiments_of,
    shell:
        "logged {log:q} deabayes further {params.results:q} --asked {params.asked:q} -o {output:q}"
