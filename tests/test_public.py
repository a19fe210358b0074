"""What tactile_fem exports: it is there, documented, and imported when it is used."""

import inspect
import subprocess
import sys

import pytest

import tactile_fem


def test_every_public_name_exists_and_is_documented():
    pytest.importorskip("tactile_fem.runtime.backend")
    for name in tactile_fem.__all__:
        thing = getattr(tactile_fem, name)
        assert thing.__name__ == name and inspect.getdoc(thing), name
        assert f"``{name}``" in tactile_fem.__doc__, name


def test_names_are_listed_and_others_are_refused():
    assert set(dir(tactile_fem)) >= {*tactile_fem.__all__, "__version__"}
    assert tactile_fem.__version__[0].isdigit()
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = tactile_fem.nothing


def loaded_by(code):
    """Return the top-level modules that a program has loaded in the end."""
    code += "\nimport sys; print(*{name.partition('.')[0] for name in sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_importing_the_package_loads_no_library():
    assert not loaded_by("import tactile_fem") & {"numpy", "pydantic", "scipy", "dolfinx"}


def test_only_computing_needs_dolfinx():
    without = [
        *("Study", "load_study", "Results", "draw", "Population", "Path", "Motion", "Piece"),
        *("RigidBody", "Distance", "Embossed", "Stimulus", "run_script", "write_table"),
        *("Ensemble", "preview"),
    ]
    imported = f"from tactile_fem import {', '.join(without)}\nimport tactile_fem.surrogate"
    assert not loaded_by(imported) & {"dolfinx", "mpi4py", "sklearn"}


def test_a_subpackage_does_not_hide_a_name():
    """A package's attribute is its subpackage as soon as that is imported."""
    code = "import tactile_fem.cli.app, tactile_fem.simulation.run, tactile_fem.vibration\n"
    code += "import tactile_fem as t, types\n"
    code += "assert not [n for n in t.__all__ if isinstance(getattr(t, n), types.ModuleType)]"
    pytest.importorskip("tactile_fem.runtime.backend")
    loaded_by(code)
