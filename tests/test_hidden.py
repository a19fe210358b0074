"""A test whose mark was forgotten fails on every machine; a marked one is skipped on a bare one."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from hidden import LIBRARIES, stub_folder

HERE = Path(__file__).parent
STAND_IN = "def initialize():\n    return 'here'\n"

MARKS = """
import subprocess, sys
import pytest
from needs import needs_gmsh

@pytest.fixture(scope="module")
def meshed():
    import gmsh
    return gmsh.initialize()

@pytest.fixture(scope="session", params=["shipped", pytest.param("built", marks=needs_gmsh)])
def either(request):
    if request.param == "shipped":
        return "here"
    import gmsh
    return gmsh.initialize()

@needs_gmsh
def test_marked():
    import gmsh
    assert gmsh.initialize() == "here"
    subprocess.run([sys.executable, "-c", "import gmsh"], check=True)

@needs_gmsh
def test_marked_with_a_shared_fixture(alone):
    assert alone == "here"

@pytest.fixture(scope="module")
def alone():
    import gmsh
    return gmsh.initialize()

def test_either(either):
    assert either == "here"

@needs_gmsh
@pytest.mark.parametrize("k", [1, 2])
def test_first_of_a_shared_fixture_FORGOTTEN(meshed, k):
    assert meshed == "here"

def test_second_of_a_shared_fixture_FORGOTTEN(meshed):
    pass

def test_imports_FORGOTTEN():
    import gmsh

def test_skips_FORGOTTEN():
    pytest.importorskip("gmsh", exc_type=ImportError)

def test_starts_a_process_FORGOTTEN():
    subprocess.run([sys.executable, "-c", "import gmsh"], check=True)

def test_draws_FORGOTTEN():
    from tactile_fem.output import pictures
    assert pictures.can_draw() is None

def test_draws_in_a_process_FORGOTTEN():
    code = "from tactile_fem.output import pictures; assert pictures.can_draw() is None"
    subprocess.run([sys.executable, "-c", code], check=True)
"""


def run_pytest(folder: Path, environment: dict[str, str], *options: str) -> tuple[int, str]:
    """Run pytest in a process of its own, and return its exit code and what it says."""
    path = os.pathsep.join([environment["PYTHONPATH"], str(HERE), *sys.path])
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-rfEs", "-p", "no:cacheprovider", *options],
        cwd=folder,
        env={**os.environ, **environment, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=300,
    )
    return done.returncode, done.stdout + done.stderr


@pytest.mark.parametrize("options", [(), ("-n", "1")])
def test_a_forgotten_mark_fails_though_the_library_is_there(tmp_path, options):
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "gmsh.py").write_text(STAND_IN)
    (tmp_path / "test_it.py").write_text(MARKS)
    full = {"PYTHONPATH": str(tmp_path / "site")}
    _, said = run_pytest(tmp_path, full, "-p", "conftest", *options)
    failed = set(re.findall(r"^(?:FAILED|ERROR) test_it\.py::(\w+)", said, flags=re.MULTILINE))
    assert failed == set(re.findall(r"def (\w+_FORGOTTEN)", MARKS)), said
    assert "4 passed" in said, said


def test_where_the_libraries_are_missing_all_tests_are_collected_and_the_marked_ones_skipped():
    folders = os.pathsep.join(map(stub_folder, LIBRARIES))
    bare = {"PYTHONPATH": folders, "LD_LIBRARY_PATH": folders}
    code, said = run_pytest(HERE.parent, bare, "-m", " or ".join(LIBRARIES))
    assert code == 0, said
    assert re.search(r"^[\d, a-z]*\b\d{2,} skipped, \d{3,} deselected in", said, re.MULTILINE), said
    assert "passed" not in said and "libGLU.so.1" in said and "libegl1" in said, said
