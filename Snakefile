# The workflow of deabayes.
from snakemake.utils import min_version

min_version("9.27")


# Jobs run in the environment that called Snakemake; the image counts only
# with `--software-deployment-method apptainer`.
container: "docker://python:3.11"


include: "workflow/rules/configuration.smk"


# Studies of one's own: `snakemake --configfile my.yaml` (replaces these). A file without `studies:`,
# such as one of sampling settings, is laid over these.
if "studies" not in config:
    say_what_is_laid_over("config.yaml")
    check_yaml("config.yaml")

    configfile: "config.yaml"


include: "workflow/rules/common.smk"
include: "workflow/rules/running.smk"
include: "workflow/rules/inputs.smk"
include: "workflow/rules/prepare.smk"
include: "workflow/rules/preview.smk"
include: "workflow/rules/identify.smk"
include: "workflow/rules/compare.smk"
include: "workflow/rules/predict.smk"
include: "workflow/rules/analyse.smk"
include: "workflow/rules/population.smk"
include: "workflow/rules/report.smk"
include: "workflow/rules/unfinished.smk"
include: "workflow/rules/faults.smk"
include: "workflow/rules/targets.smk"


localrules:
    all,
    faults,
    population_settings,


rule all:
    default_target: True
    input:
        "<results>/report/index.html",
        expand("<results>/{study}/preview", study=STUDIES),
        expand("<results>/{study}/faults", study=FAULTS),
