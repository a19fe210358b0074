"""What must hold for any study file and any history: a sentence or a result, never a NaN."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import tomlkit
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydantic import BaseModel

from tactile_fem.errors import StudyError
from tactile_fem.neuron import respond
from tactile_fem.study import Afferents, Joint, Neuron, People, Stimulus, Study
from tactile_fem.study.file import dump_study, load_study

# The same examples in every run, on however slow a machine.
RUN: dict[str, Any] = {
    "derandomize": True,
    "deadline": None,
    "database": None,
    "suppress_health_check": [HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
}

NUMBERS = st.one_of(
    st.integers(-(2**63), 2**63 - 1),
    st.floats(),
    st.floats(0.0, 10.0),
    st.sampled_from([0, 1, -1, 1e-300, 1e300]),
)
WORDS = st.one_of(
    st.text(st.characters(exclude_categories=["Cs", "Cc"]), max_size=8),
    st.sampled_from(["", "coarse", "x", "text", "FGH", "fitted", "0.2 mm", "nan", "bone"]),
)
KEYS = WORDS.filter(bool)
VALUES = st.recursive(
    st.one_of(NUMBERS, WORDS, st.booleans()),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(KEYS, inner, max_size=2)),
    max_leaves=4,
)


def keys_of(section: str) -> list[str]:
    if section == "stimulus":
        return sorted({key for kind in Stimulus.kinds.values() for key in kind.model_fields})
    absent: dict[str, type[BaseModel]]  # by default
    absent = {"joint": Joint, "people": People, "afferents": Afferents}
    return list(absent.get(section, type(getattr(Study(), section))).model_fields)


def tables(section: str) -> st.SearchStrategy[Any]:
    """Return known keys with any values, now and then an unknown one or no table."""
    known = st.dictionaries(st.sampled_from(keys_of(section)), VALUES, max_size=3)
    return st.one_of(known, known, st.dictionaries(KEYS, VALUES, max_size=2), VALUES)


SECTIONS = {name: tables(name) for name in Study.model_fields}
SECTIONS["afferents"] = st.one_of(st.lists(tables("afferents"), max_size=2), tables("afferents"))
STUDIES = st.fixed_dictionaries({}, optional=SECTIONS)


def assert_loads_or_says(load: Callable[[], Study]) -> Study | None:
    """Return the study, or None after sentences that a person can read."""
    try:
        study = load()
    except StudyError as error:
        sentences = str(error).splitlines()
        assert sentences and all(sentence.strip() for sentence in sentences)
        assert not any("Traceback" in sentence or "pydantic" in sentence for sentence in sentences)
        return None
    assert all(map(math.isfinite, numbers_in(study.model_dump())))
    return study


def numbers_in(value: Any) -> Iterator[float]:
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list | tuple):
        for entry in value:
            yield from numbers_in(entry)
    elif isinstance(value, float):
        yield value


@settings(max_examples=400, **RUN)
@given(STUDIES)
def test_any_table_of_known_keys_is_a_study_or_a_sentence(tmp_path, data):
    path = tmp_path / "study.toml"
    path.write_text(tomlkit.dumps(data), encoding="utf-8")
    study = assert_loads_or_says(lambda: load_study(path))
    if study is not None:
        path.write_text(dump_study(study), encoding="utf-8")
        assert load_study(path) == study


@settings(max_examples=200, **RUN)
@given(st.one_of(st.binary(max_size=60), st.text(max_size=60)))
def test_any_file_is_a_study_or_a_sentence(tmp_path, content):
    path = tmp_path / "study.toml"
    text = isinstance(content, str)
    path.write_bytes(content.encode("utf-8", "replace") if text else content)
    assert_loads_or_says(lambda: load_study(path))


PLACES = [f"{section}.{key}" for section in Study.model_fields for key in keys_of(section)]
SETTINGS = st.one_of(
    st.tuples(st.sampled_from(PLACES), st.one_of(NUMBERS, WORDS)).map("{0[0]}={0[1]}".format),
    st.text(max_size=20),
    st.text("abc.=_[]\"'# 1", max_size=12),
)


@settings(max_examples=300, **RUN)
@given(st.lists(SETTINGS, max_size=3))
def test_any_setting_is_a_study_or_a_sentence(overrides):
    assert_loads_or_says(lambda: load_study(None, overrides))


# --- neuron ------------------------------------------------------------------------------------


def positive(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(math.log(low), math.log(high)).map(math.exp)


NEURONS = st.builds(
    Neuron,
    static_gain_pA_per_kPa=st.one_of(st.just(0.0), positive(1e-6, 1e6)),
    dynamic_gain_pA_s_per_kPa=st.one_of(st.just(0.0), positive(1e-6, 1e6)),
    adaptation=st.floats(0.0, 1.0),
    adaptation_time_s=positive(1e-6, 1e6),
    intercept_pA=st.one_of(st.none(), st.floats(-1e3, 1e3)),
    capacitance_pF=positive(1e-2, 1e4),
    resistance_GOhm=positive(1e-2, 1e3),
    threshold_mV=positive(1e-2, 1e3),
    refractory_s=positive(2e-4, 1e2),
    gain_spread=st.floats(0.0, 1.0),
    threshold_noise=st.floats(0.0, 0.5),
)


@st.composite
def histories(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    """Return valid times and strain energy densities."""
    count = draw(st.integers(2, 6))
    gaps = draw(arrays(float, count - 1, elements=st.floats(1e-6, 0.1)))
    time = draw(st.floats(-1.0, 1.0)) + np.concatenate([[0.0], np.cumsum(gaps)])
    receptors = draw(st.integers(0, 3))
    return time, draw(arrays(float, (count, receptors), elements=st.floats(0.0, 1e3)))


@settings(max_examples=200, **RUN)
@given(histories(), NEURONS)
def test_spikes_of_any_history_are_finite_ordered_and_within_it(history, neuron):
    time, sed = history
    response = respond(time, sed, neuron)
    assert len(response.spikes) == sed.shape[1]
    for spikes in response.spikes:
        assert np.isfinite(spikes).all()
        assert np.all((spikes >= time[0]) & (spikes <= time[-1] + 1e-9))
        assert np.all(np.diff(spikes) >= neuron.refractory_s * (1 - 1e-9) - 1e-12)
    assert np.isfinite(response.rate(time, 0.01)).all()
    edges, counts = response.psth(0.01)
    assert np.isfinite(edges).all()
    np.testing.assert_array_equal(counts.sum(axis=0), response.counts())


ANYTHING = st.one_of(
    arrays(float, st.tuples(st.integers(0, 4)), elements=st.floats()),
    arrays(float, st.tuples(st.integers(0, 4), st.integers(0, 3)), elements=st.floats()),
    st.none(),
    st.text(max_size=3),
    st.lists(st.one_of(st.none(), st.floats(), st.text(max_size=2)), max_size=4),
)


@settings(max_examples=300, **RUN)
@given(ANYTHING, ANYTHING)
def test_any_arrays_are_a_response_or_a_sentence(time, sed):
    try:
        response = respond(time, sed, Neuron())
    except StudyError as error:
        assert str(error).strip()
    else:
        assert all(np.isfinite(spikes).all() for spikes in response.spikes)
