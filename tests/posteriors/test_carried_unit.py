"""Values are taken in the unit that their name tells of, or not at all."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from tests.posteriors.test_predict_with import file

from deabayes.api import Posterior
from deabayes.faults import UserError
from deabayes.prediction.given import array_in_si

VALUES = [1.0, 2.0]
SI = {"voltage": "V", "time": "s", "strain": "1", "displacement": "m", "frequency": "Hz"}


@pytest.mark.parametrize("kind", [pd.Series, pd.Index])
@pytest.mark.parametrize(
    ("name", "channel", "unit"),
    [
        ("voltage (kV)", "voltage", "kV"),
        ("kV", "voltage", "kV"),
        ("U_kv", "voltage", "kV"),
        ("voltage (kilovolts)", "voltage", "kilovolts"),
        ("Voltage in kilovolts", "voltage", "kilovolts"),
        (("U", "kV"), "voltage", "kV"),
        ("time_ms", "time", "ms"),
        ("t / ms", "time", "ms"),
        ("displacement_mm_filtered", "displacement", "mm"),
        ("displacement_\u03bcm", "displacement", "\u00b5m"),
        ("strain_%", "strain", "%"),
        ("f (kHz)", "frequency", "kHz"),
    ],
)
def test_a_name_with_another_unit_is_refused(
    kind: type, name: str | tuple[str, str], channel: str, unit: str
) -> None:
    """How it is to be called instead is what is understood."""
    with pytest.raises(UserError, match=rf"{channel}: the values are called") as error:
        array_in_si(kind(VALUES, name=name), SI[channel], channel)
    assert f"rename them '{channel} [{unit}]' if they are, or {channel!r} if" in str(error.value)
    renamed = kind(VALUES, name=f"{channel} [{unit}]")
    assert array_in_si(renamed, SI[channel], channel)[0] != 1.0
    plain = kind(VALUES, name=channel)
    np.testing.assert_array_equal(array_in_si(plain, SI[channel], channel), VALUES)


@pytest.mark.parametrize(
    ("name", "channel"),
    [
        *((None, "voltage"), (0, "voltage"), (10000, "strain"), ("", "voltage"), ("v", "voltage")),
        *(("voltage (V)", "voltage"), ("voltage_V", "voltage"), ("volts", "voltage")),
        *(("voltage (monitor)", "voltage"), ("voltage (1)", "voltage"), ("t_m", "time")),
        *(("voltage_min", "voltage"), ("voltage_av", "voltage"), ("x", "displacement")),
        *(("time_seconds", "time"), ("strain (-)", "strain"), ("frequency (1/s)", "frequency")),
    ],
)
def test_any_other_name_is_none_of_a_unit(name: object, channel: str) -> None:
    given = pd.Series(VALUES, name=name)
    np.testing.assert_array_equal(array_in_si(given, SI[channel], channel), VALUES)


def test_a_parameter_whose_name_contains_a_unit_is_called_so() -> None:
    """In pint alpha is the fine-structure constant; draws of J_alpha are plain numbers."""
    given = pd.Series(VALUES, name="J_alpha")
    np.testing.assert_array_equal(array_in_si(given, "1", "parameter J_alpha"), VALUES)


@pytest.mark.parametrize("name", ["voltage (mm)", "voltage (V/m)"])
def test_a_unit_of_another_dimension_in_brackets_is_refused(name: str) -> None:
    with pytest.raises(UserError, match=r"voltage: unit '.*' is .*, expected a voltage"):
        array_in_si(pd.Series(VALUES, name=name), "V", "voltage")


def test_kilovolts_are_not_predicted_as_volts() -> None:
    post = Posterior(file(None))
    with pytest.raises(UserError, match=r"rename them 'voltage \[kV\]'"):
        post.predict(time=[0.0, 0.5], voltage=pd.Series([0.0, 1.8], name="voltage (kV)"))
