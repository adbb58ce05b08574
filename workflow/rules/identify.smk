rule fit:
    input:
        records=prepared_to_fit,
        model=own_model,
        prior=inherited_posterior,
    output:
        settings="<results>/{study}/{candidate}/settings.yaml",
        posterior="<results>/{study}/{candidate}/posterior.nc",
        summary="<results>/{study}/{candidate}/summary.csv",
    log:
        "<results>/{study}/{candidate}/logs/fit.log",
    threads: 1
    params:
        settings=settings_of_candidate,
        specimen=content_of_specimen,
        code=digest_of("pipeline.fit"),
        prepared=prepared_folder,
    shell:
        "printf '%s\n' {params.settings:q} > {output.settings:q};"
        " logged {log:q} deabayes fit {output.settings:q} {wildcards.candidate:q}"
        " --prepared {params.prepared:q} -o {output.posterior:q} --summary {output.summary:q}"
