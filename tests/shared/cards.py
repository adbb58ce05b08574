"""Posteriors of solids, and their material cards read back, for tests."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np
from tests.shared import membranes, structures, tube_trees
from tests.shared.tube_trees import specimen as tube

from deabayes.experiment import Specimen
from deabayes.export import export

SPECIMENS = {
    "tubular": tube(),
    "membrane": membranes.PLAIN,
    "tensile_strip": Specimen("strip", "tensile_strip", {}, {}),
    "minimum_energy_structure": structures.PLAIN,
}
CENTRES = tube_trees.CENTRES | {
    "mu_alpha": 30e3, "zeta_alpha": 20e3, "J_alpha": 90.0, "J_beta": 60.0, "mu": 40e3, "J": 80.0,
    "mu_beta_1": 20e3, "mu_beta_2": 10e3, "mu_beta_3": 5e3, "mu_beta_4": 4e3,
    "tau_beta_1": 3.0, "tau_beta_2": 60.0, "tau_beta_3": 300.0, "tau_beta_4": 2000.0,
    "mu_1": 20e3, "mu_2": 1e3, "mu_3": 3e3, "mu_4": 100.0, "mu_5": 50.0,
    "alpha_1": 1.2, "alpha_2": 4.0, "alpha_3": 4.5, "alpha_4": 5.0, "alpha_5": 5.5,
    "k_1": 60.0, "k_2": 8.0, "k_3": 3.5, "k_4": 0.8, "eta_0": 0.1, "friction_force": 1e-3,
    "E_3": 9e6, "tau_3": 1.0, "tau_4": 50.0,
}  # fmt: skip


def posterior(system, candidate, size=50, converged=True, of=None):
    given = of or SPECIMENS[system]
    return tube_trees.tree(candidate, size, 0.1, converged, given, CENTRES)


def written(tree, program, folder, **options):
    path = folder / f"cards.{'inp' if program == 'abaqus' else 'mac'}"
    export(tree, program, path, **options)
    return path.read_text(encoding="ascii")


def sentences(text):
    """Comments, each sentence on a line of its own."""
    found = []
    for line in text.splitlines():
        match = re.match(r"(?:\*\*|!)( {1,3})(\S.*)", line)
        if match and len(match[1]) == 3:
            found[-1] += f" {match[2]}"
        elif match:
            found.append(match[2])
    return found


@dataclass
class Material:
    """A material as the program reads it."""

    name: str
    law: str = ""
    moduli: str = "LONG TERM"
    data: list[float] = field(default_factory=list)
    shares: list[float] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    density: float | None = None
    pairs: list[float] = field(default_factory=list)
    terms: int = 0


def abaqus(text):
    materials, taking = [], ""
    for line in text.splitlines():
        if line.startswith("**"):
            continue
        if line.startswith("*"):
            keyword, *options = [part.strip() for part in line[1:].split(",")]
            named = dict(o.split("=") for o in options if "=" in o)
            taking = keyword
            if keyword == "MATERIAL":
                materials.append(Material(named["NAME"]))
            elif keyword in ("ELASTIC", "HYPERELASTIC"):
                laws = [o for o in options if "=" not in o]
                materials[-1].law = f"{keyword} {' '.join(laws)} {named.get('N', '')}".strip()
                materials[-1].moduli = named.get("MODULI", "LONG TERM")
            continue
        values = [float(value) for value in line.rstrip(",").split(",")]
        assert len(values) <= 8
        if taking == "DENSITY":
            materials[-1].density = values[0]
        elif taking == "VISCOELASTIC":
            assert values[1] == 0.0
            materials[-1].shares.append(values[0])
            materials[-1].times.append(values[2])
        else:
            materials[-1].data += values
    return materials


def ansys(text):
    materials, table = {}, []
    for line in (line for line in text.splitlines() if not line.startswith("!")):
        command, *rest = line.split(",")
        if command == "TBDATA":
            values = [float(value) for value in rest[1:]]
            assert int(rest[0]) == len(table) + 1 and len(values) <= 6
            table += values
            continue
        material = materials.setdefault(rest[1], Material(rest[1], moduli="INSTANTANEOUS"))
        if command == "MP" and rest[0] == "DENS":
            material.density = float(rest[2])
        elif command == "MP":
            material.law = f"{material.law} {rest[0]}".strip()
            material.data.append(float(rest[2]))
        elif rest[0] == "HYPER":
            material.law, table = f"{rest[4]} {rest[3]}".strip(), material.data
        else:
            assert rest[0] == "PRONY" and rest[4] == "SHEAR"
            table = material.pairs
            material.terms = int(rest[3])
    for material in materials.values():
        material.shares, material.times = material.pairs[::2], material.pairs[1::2]
        assert len(material.shares) == material.terms
    return list(materials.values())


PROGRAMS = ("abaqus", "ansys")
READ = {"abaqus": abaqus, "ansys": ansys}


def nominal(energy, stretch, deformation):
    """dU/dlambda by complex step, over the number of directions pulled."""
    stretch = stretch + 1e-30j
    others = {"uniaxial": (stretch**-0.5, stretch**-0.5), "equibiaxial": (stretch, stretch**-2.0)}
    work = energy(stretch, *others[deformation])
    return np.imag(work) / 1e-30 / (2.0 if deformation == "equibiaxial" else 1.0)


def energy(program, material):
    """The published strain energy of a program's law, from a card's data."""
    data, law = material.data, material.law

    def invariant(*stretches):
        return sum(each**2 for each in stretches) - 3.0

    if "OGDEN" in law:
        terms = int(law.split()[-1])
        assert len(data) == 3 * terms and data[2 * terms :] == [0.0] * terms
        pairs = list(zip(data[: 2 * terms : 2], data[1 : 2 * terms : 2], strict=True))

        def factor(mu, alpha):
            return 2.0 * mu / alpha**2 if program == "abaqus" else mu / alpha

        return lambda *s: sum(factor(m, a) * (sum(x**a for x in s) - 3.0) for m, a in pairs)
    if law == "HYPERELASTIC REDUCED POLYNOMIAL 6":
        assert len(data) == 12 and data[6:] == [0.0] * 6
        return lambda *s: sum(c * invariant(*s) ** k for k, c in enumerate(data[:6], start=1))
    if law == "GENT":
        mu, limit, zero = data
        assert zero == 0.0
        return lambda *s: -0.5 * mu * limit * np.log(1.0 - invariant(*s) / limit)
    first, zero = data
    assert zero == 0.0 and law in ("HYPERELASTIC NEO HOOKE", "NEO")
    return lambda *s: (first if program == "abaqus" else 0.5 * first) * invariant(*s)
