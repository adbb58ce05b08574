"""What records of one noise group must have in common, and whose sensor's noise they have."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from deabayes.experiment import Excitation, Experiment, Quantity
from deabayes.faults import UserError
from deabayes.inference.record_noise import noise_parameters
from deabayes.noise import REGISTRY
from deabayes.prior.distributions import LogNormal
from deabayes.study import Study

STUDY = Study("mixed", Path("data"), ("ogden_1",), noise_scale="range")
SYSTEM = SimpleNamespace(
    proportional=(),
    responses={"force": "N", "displacement": "m"},
    specimen=SimpleNamespace(instruments={"force.noise": Quantity(1e-3, "N")}),
)


def rising(name, driven, response, read):
    coordinate = np.linspace(0.0, driven[2], read.size)
    return Experiment(
        name, "quasi_static", "calibrate", driven[0], driven[1], coordinate, *response, read,
        np.ones(read.size), Excitation(*driven[:2], coordinate, coordinate),
    )  # fmt: skip


PULL = rising("pull", ("displacement", "m", 0.02), ("force", "N"), np.linspace(0.0, 0.1, 40))
RAISED = rising("raised", ("voltage", "V", 5e3), ("force", "N"), np.linspace(0.0, 0.1, 40))
BENT = rising("bent", ("voltage", "V", 5e3), ("displacement", "m"), np.linspace(0.0, 2e-3, 40))


def parameters(*experiments, noise="ornstein_uhlenbeck", **changes):
    made = noise_parameters(replace(STUDY, **changes), REGISTRY[noise](), experiments, SYSTEM)
    return {parameter.name: parameter for parameter in made}


def test_a_length_in_metres_is_none_in_volts():
    with pytest.raises(UserError, match="records along coordinates in V and in m, which cannot"):
        parameters(PULL, RAISED)
    assert parameters(PULL, RAISED, noise="white")
    assert parameters(PULL, RAISED, noise_coordinate="grid")
    apart = parameters(PULL, RAISED, noise_groups="experiment")
    assert (apart["pull.tau_ou"].unit, apart["raised.tau_ou"].unit) == ("m", "V")


@pytest.mark.parametrize("order", [[RAISED, BENT], [BENT, RAISED]])
def test_the_noise_of_one_sensor_is_none_of_records_of_two(order):
    one = parameters(RAISED)["quasi_static.sigma_white"]
    assert one.prior == LogNormal(1e-3 / 0.1, 0.4) and "specimen.yaml" in one.source
    both = parameters(*order)["quasi_static.sigma_white"]
    assert both.prior == parameters(BENT)["quasi_static.sigma_white"].prior
    assert "specimen.yaml" not in both.source


def test_noise_without_a_white_part_cannot_read_one_place_twice():
    again = replace(PULL, coordinate=np.repeat(PULL.coordinate[:20], 2))
    with pytest.raises(UserError, match=r"record pull: 20 readings repeat their displacement \(th"):
        parameters(again, noise="ar1")
    assert parameters(again) and parameters(again, noise="ar1", noise_coordinate="grid")
    assert parameters(PULL, noise="ar1")
