"""A run that ends without what it was asked for does not end with success."""


def not_made():
    """The files asked for that are not there.

    After a job that runs again Snakemake looks only where inputs are not `ancient`. Those of
    `compile` are, and all studies meet in it: the edit of one can hide what another lacks.
    """
    asked = workflow.dag_settings
    if asked.until or asked.omit_from or asked.batch:
        return []
    files = [target for target in asked.targets if not workflow.is_rule(target)]
    return [file for file in files if not Path(file).exists()]


onsuccess:
    left = not_made()
    if left:
        raise WorkflowError(
            f"{', '.join(left)}: not made, an edit elsewhere came first; run the same command again"
        )
