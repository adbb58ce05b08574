"""Targets of the command line: one that nothing makes ends the run with a sentence."""

from deabayes.faults import nearest


def outputs_of(made_by):
    """Outputs of a rule, with wildcards as they are written in it."""
    return [re.sub(r"\{(\w+),[^}]*\}", r"{\1}", str(each)) for each in made_by.output]


def known_targets():
    """Results of studies and candidates that can be asked for."""
    for pattern in (each for made_by in workflow.rules for each in outputs_of(made_by)):
        for name, study in STUDIES.items():
            if set(re.findall(r"\{(\w+)\}", pattern)) <= {"study", "candidate"}:
                yield from expand(pattern, study=name, candidate=study.candidates)


def fault_of_target(target):
    """Say that nothing makes a target, and what may be meant; None if something does."""
    if workflow.is_rule(target):
        asked_for = workflow.get_rule(target)
        if not asked_for.has_wildcards():
            return None
        made = outputs_of(asked_for)[-1]
        return f"{target}: is a rule; name one of the files that it makes: {made}"
    place = Path(target)
    if place.exists() and not place.is_dir():
        return None
    if any(each.is_producer(str(place)) for each in workflow.rules):
        return None
    study = place.relative_to(RESULTS) if place.is_relative_to(RESULTS) else place
    if str(study) in STUDIES:
        return (
            f"{target}: is a study; name a result of it: {RESULTS / study / 'figures'}"
        )
    hint = nearest(target, known_targets())
    if "known:" in hint:
        hint = f"; name a result, such as {RESULTS / next(iter(STUDIES), 'NAME') / 'figures'}"
    return f"{target}: nothing makes such a file{hint}"


if wrong := list(filter(None, map(fault_of_target, TARGETS))):
    end("\n".join(wrong))
if workflow.is_main_process:
    say_what_is_left_out()
