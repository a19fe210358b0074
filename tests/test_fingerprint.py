"""Own parts are told from others by their code and their values, in any process."""

from __future__ import annotations

import importlib
import math
import subprocess
import sys
import threading
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial

import numpy as np
import pytest

from tactile_fem.errors import StudyError
from tactile_fem.runtime.fingerprint import fingerprint
from tactile_fem.simulation.parts import Parts, changed_part
from tactile_fem.study import Plate, Protocol, Text

SCALE = 2.0


def gravity(tissues, g=9.81):
    return g * SCALE


def halved(tissues):
    return gravity(tissues) / 2


class Weight:
    g = 9.81

    def __init__(self, tissues=None, along=(0, 0, 1)):
        self.along = along

    def residual(self, v):
        return self.g * v

    @cached_property
    def slow(self):
        return 1.0


class Moon(Weight):
    g = 1.62


class Sideways(Weight):
    def residual(self, v):
        return self.g * v[0]


class Slotted:
    __slots__ = ("g",)

    def __init__(self, g):
        self.g = g


@dataclass(frozen=True)
class Law:
    """It has the same energy for any slope at X = 0."""

    slope: float
    table: object = None

    def energy(self, F, at):
        return self.slope * at.X[0] * F[0, 0]


@dataclass(frozen=True)
class Other(Law):
    def energy(self, F, at):
        return self.slope * at.X[1] * F[0, 0]


@lru_cache
def cached(tissues):
    return gravity(tissues)


def of(value) -> str:
    return fingerprint(value, "it")


def closure(value, default=0):
    return lambda tissues, g=default: (value, g)


def parts() -> dict[str, object]:
    """Return parts of which no two are the same, made anew at each call."""
    return {
        "function": gravity,
        "caller": halved,
        "partial": partial(gravity, g=9.81),
        "partial 0": partial(gravity, g=0.0),
        "partial by place": partial(gravity, 9.81),
        "closure": closure(1.0),
        "closure 2": closure(2.0),
        "closure of array": closure(np.arange(3.0)),
        "default": closure(1.0, 3),
        "class": Weight,
        "subclass": Moon,
        "override": Sideways,
        "instance": Weight(),
        "instance along X": Weight(along=(1, 0, 0)),
        "method": Weight().residual,
        "method along X": Weight(along=(1, 0, 0)).residual,
        "slots": Slotted(1.0),
        "slots 2": Slotted(2.0),
        "law": Law(1.0),
        "law 2": Law(2.0),
        "law with a table": Law(1.0, np.arange(3)),
        "law with floats": Law(1.0, np.arange(3.0)),
        "law with a set": Law(1.0, {"a", "b", "c"}),
        "law with a mapping": Law(1.0, {"a": 1, "b": [2, math.nan]}),
        "law with a law": Law(1.0, Law(2.0)),
        "other law": Other(1.0),
        "cached": cached,
        "library": math.sin,
        "ufunc": np.sin,
        "text": Text(text="G").body(),
        "text C": Text(text="C").body(),
        "plate": Plate().body(),
        "route": Protocol().route(2.0),
        "shorter route": Protocol(distance_mm=3.0).route(2.0),
    }


def test_parts_are_equal_if_their_code_and_values_are():
    found, again = ({name: of(part) for name, part in parts().items()} for _ in range(2))
    assert found == again
    assert len(set(found.values())) == len(found)


def test_a_changed_global_is_another_part(monkeypatch):
    before = of(gravity), of(halved)
    monkeypatch.setattr(sys.modules[__name__], "SCALE", 3.0)
    assert not set(before) & {of(gravity), of(halved)}


def test_what_is_computed_when_it_is_used_does_not_matter():
    used = Weight()
    assert used.slow == 1.0
    assert of(used) == of(Weight())


def test_other_processes_find_the_same():
    script = (
        f"import sys; sys.path[:0] = {sys.path!r}; import test_fingerprint as own; "
        "print([own.of(part) for part in own.parts().values()])"
    )
    output = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    ).stdout
    assert output.strip() == str([of(part) for part in parts().values()])


def test_a_cycle_ends():
    ring: list = [1.0]
    ring.append(ring)
    assert of(Law(1.0, ring)) == of(Law(1.0, ring))


@pytest.mark.parametrize("held", [threading.Lock(), (k for k in range(3)), sys.stdout])
def test_what_cannot_be_hashed_is_refused(held):
    with pytest.raises(
        StudyError, match=r"^parts: the term 1 refers to an object of the type \S+,"
    ):
        Parts(terms=(partial(gravity, g=held),)).identity()


def test_the_first_part_that_changed_is_named():
    def identity(g, law=1.0):
        return Parts(laws={"dermis": Law(law)}, terms=(partial(gravity, g=g),)).identity()

    assert not changed_part(identity(9.81), identity(9.81))
    assert "a term 1 that was functools.partial" in changed_part(identity(9.81), identity(0.0))
    assert "a law of dermis that was " in changed_part(identity(9.81), identity(9.81, law=2.0))


def test_files_and_own_modules_count_by_their_content(tmp_path, monkeypatch):
    file = tmp_path / "own_module_of_a_script.py"
    monkeypatch.syspath_prepend(tmp_path)
    found = []
    for text in ("g = 1.0\n", "g = 2.0\n"):
        file.write_text(text)
        module = importlib.import_module(file.stem)
        found += [of(Law(1.0, file)), of(partial(gravity, module))]
    assert len(set(found)) == 4
    assert of(Law(1.0, tmp_path / "none")) == of(Law(1.0, tmp_path / "none"))
