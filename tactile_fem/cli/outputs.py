"""The commands that write files: studies, meshes, figures; and `doctor`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from tactile_fem.cli.comparison import named_scans, show_comparison
from tactile_fem.cli.options import (
    OWN_SIZE,
    Changes,
    ScanFolder,
    Size,
    StudyFile,
    Written,
    check_file,
)
from tactile_fem.errors import StudyError
from tactile_fem.runtime import doctor as diagnosis


def init(file: Path = Path("study.toml"), /, *, study: Path | None = None) -> None:
    """Write a study file with every value commented out at its default, or copy a shipped study.

    Parameters
    ----------
    file
        Name of the new file.
    study
        Copy this study, such as hamasaki2020, with its comments.
    """
    from tactile_fem.runtime.files import write_text
    from tactile_fem.study.file import study_file
    from tactile_fem.study.template import commented_template

    if file.exists():
        raise StudyError(f"{file} exists already: choose another name.")
    check_file("FILE", file)
    write_text(file, study_file(study).read_text() if study else commented_template())
    print(f"Written to {file}")


def mesh(
    study: StudyFile = None, /, *, changes: Changes = (), output: Written | None = None
) -> None:
    """Mesh the finger and print its sizes, volumes, layers and quality.

    Parameters
    ----------
    output
        Write the mesh to this .msh file.
    """
    from tactile_fem import load_study
    from tactile_fem.finger import describe, write_mesh

    finger = load_study(study, changes).finger
    if output is not None:
        check_file("--output", output, ".msh")
    the_mesh = finger.mesh()
    print(describe(the_mesh, finger))
    if output is not None:
        write_mesh(output, the_mesh)
        print(f"Written to {output}")


def fields(
    results: ScanFolder,
    /,
    *,
    output: Written | None = None,
    on: Literal["skin", "interface"] = "skin",
    side: Literal["epidermis", "dermis"] = "epidermis",
    at_mm: float | None = None,
    at_s: float | None = None,
    show: str = "sed_kPa",
    size: Size = OWN_SIZE,
) -> None:
    """Write contact, displacement, stretches, stress and SED on the skin or the interface.

    Without --output, list the states whose fields the scan has kept.

    Parameters
    ----------
    output
        Write this file: .csv, .npz, .vtu for ParaView and PyVista, or a map, .png.
    on
        The skin, or the interface of epidermis and dermis.
    side
        The side of the interface.
    at_mm
        Displacement of the nearest kept state; by default, the state with the largest force.
    at_s
        Time of a state, which may lie in a press or a hold.
    show
        Column of the table that the map shows, or one of sed, displacement, stretch, von_mises,
        pressure, friction, slip.
    """
    from tactile_fem import Results
    from tactile_fem.results.surfaces import ENDINGS

    found = Results.open(results)
    if output is None:
        names = ["time_s", "displacement_mm", "depth_mm"]
        print(",".join([*names, f"normal_{found.study.finger.force_unit}"]))
        columns = [*(found.trace[name] for name in names), found.trace["force_N"][:, 2]]
        for values in zip(*(column[found.kept_rows] for column in columns), strict=True):
            print(",".join(f"{value:.6g}" for value in values))
        return
    check_file("--output", output, *ENDINGS, ".png")
    if on == "skin":
        surface = found.skin(at_mm, at_s=at_s)
    else:
        surface = found.interface(at_mm, at_s=at_s, side=side)
    if output.suffix == ".png":
        from tactile_fem.output.film import titles_of
        from tactile_fem.output.maps import surface_map
        from tactile_fem.runtime.files import write_figure

        (title,) = titles_of(found.trace, [surface.time_s])
        with size.used():
            write_figure(output, surface_map(surface, show, title))
    else:
        surface.save(output)
    print(f"{len(surface)} points at {surface.at_mm:g} mm, {surface.time_s:g} s")
    print(f"Written to {output}")


def plot(results: ScanFolder, /, *, size: Size = OWN_SIZE) -> None:
    """Draw all figures of a scan again; text and lines have the same size at any resolution."""
    from tactile_fem import Results

    found = Results.open(results)
    from tactile_fem import draw

    for path in draw(found, dpi=size.dpi, width_mm=size.width_mm):
        print(path)


def compare(
    *scans: ScanFolder, output: Written = Path("comparison.png"), size: Size = OWN_SIZE
) -> None:
    """Print the numbers of complete scans and draw their histories on common axes.

    The table states differences to the first scan. Scans are named after their folders.

    Parameters
    ----------
    output
        Write this .png file, which is replaced.
    """
    check_file("--output", output, ".png")
    with size.used():
        show_comparison(named_scans(scans), output)


def doctor() -> int:
    """Check the compiler and libraries that pip cannot install, and name their packages."""
    code = diagnosis.main()
    try:
        from tactile_fem.runtime import backend
    except ImportError as error:
        print(f"Error: {error}")
        return 1
    print(f"DOLFINx {backend.DOLFINX_VERSION}")
    return code


COMMANDS = (init, mesh, fields, plot, compare, doctor)
