rule population_settings:
    output:
        "<results>/populations/{population}/population.yaml",
    log:
        "<results>/populations/{population}/logs/settings.log",
    params:
        settings=settings_of_population,
    shell:
        "printf '%s\n' {params.settings:q} > {output:q} 2> {log:q}"


rule population:
    input:
        population="<results>/populations/{population}/population.yaml",
        posteriors=posteriors_of_members,
        records=prepared_of_members,
    output:
        posterior="<results>/populations/{population}/posterior.nc",
        summary="<results>/populations/{population}/summary.csv",
        shrinkage="<results>/populations/{population}/shrinkage.csv",
        predictions=directory("<results>/populations/{population}/predictions"),
        errors="<results>/populations/{population}/errors.csv",
    log:
        "<results>/populations/{population}/logs/population.log",
    threads: 1
    params:
        code=digest_of("population.files", "posteriors.fitted", "prediction.errors"),
        folder=subpath(output.posterior, parent=True),
        results=subpath(output.posterior, ancestor=3),
    shell:
        "logged {log:q} deabayes population {input.population:q} --results {params.results:q}"
        " -o {params.folder:q}"


rule population_figures:
    input:
        posterior="<results>/populations/{population}/posterior.nc",
        shrinkage="<results>/populations/{population}/shrinkage.csv",
        predictions="<results>/populations/{population}/predictions",
    output:
        directory("<results>/populations/{population}/figures"),
    log:
        "<results>/populations/{population}/logs/figures.log",
    threads: 1
    params:
        code=digest_of("figures", "papers"),
        results=subpath(output[0], parent=True),
    shell:
        "logged {log:q} deabayes figures {params.results:q} -o {output:q}"
