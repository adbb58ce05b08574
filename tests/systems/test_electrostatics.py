import numpy as np
import pytest
from tests.shared.golden import load_golden

from deabayes.systems.electrostatics import maxwell_pressure


def test_pressure_of_the_golden_step():
    inputs = load_golden("tubular_creep_compliance")["inputs"]
    pressure = maxwell_pressure(
        inputs["voltage_V"], inputs["thickness_m"], inputs["relative_permittivity"]
    )
    assert pressure == pytest.approx(inputs["sigma0_Pa"], rel=1e-13)


def test_pressure_is_even_and_quadratic_in_voltage_and_broadcasts():
    pressure = maxwell_pressure([-1000.0, 1000.0, 2000.0], 80e-6, np.array([[3.1], [6.2]]))
    assert pressure.shape == (2, 3)
    assert pressure[0, 0] == pressure[0, 1]
    assert pressure[0, 2] == pytest.approx(4 * pressure[0, 1], rel=1e-15)
    assert pressure[1] == pytest.approx(2 * pressure[0], rel=1e-15)
