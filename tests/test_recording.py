"""A recorded stroke: whose frame it is in, when contact begins, what is noise, and wrong signs."""

import dataclasses

import numpy as np
import pytest
from synthetic import PRESS, make_trace

from tactile_fem.errors import StudyError
from tactile_fem.path import Follow, Press, Protocol
from tactile_fem.path.recording import Frame, Recording
from tactile_fem.results.measured import check_measured, compare
from tactile_fem.study import Output, Plate, Study
from tactile_fem.study.file import dump_study, load_study

TIME = np.array([0.0, 0.02, 0.03, 0.04, 0.06, 0.1, 0.3])
# Of the body in the finger's axes: it comes, presses and slides to the palm and across.
BODY = {
    "x_mm": [0.0, 0, 0, 0, 0, 0, 2],
    "y_mm": [0.0, 0, 0, 0, 0, 0, -4],
    "z_mm": [-0.5, 0, 0.25, 0.5, 1, 1, 1],
    "fx_N": [0.0, 0, 0, 0, 0, 0.1, 0.1],
    "fy_N": [0.0, 0, 0, 0, 0, -0.1, -0.2],
    "fz_N": [0.0, 0, 0.05, 0.2, 0.6, 0.6, 0.5],
    "tz_Nmm": [0.0, 0, 0, 0, 0.1, 0.2, 0.4],
}
LAB_MM = np.array([312.0, 145.0, 21.7])


def written(folder, name="stroke.csv", time_s=TIME, **columns):
    table = np.column_stack([time_s, *columns.values()])
    heading = ",".join(["time_s", *columns])
    np.savetxt(folder / name, table, delimiter=",", header=heading, comments="", fmt="%.15g")
    return folder / name


def reversed_(names, columns=BODY):
    return {k: -np.array(v) if k in names else np.array(v) for k, v in columns.items()}


def in_the_lab():
    """Return the finger over a plate at rest, along the laboratory's x, and forces on the plate."""
    body = {name: np.array(values) for name, values in BODY.items()}
    x, y, z = LAB_MM[:, None] - [body["y_mm"], -body["x_mm"], body["z_mm"]]
    fx, fy, fz = -body["fy_N"], body["fx_N"], -body["fz_N"]
    tz = -body["tz_Nmm"] + LAB_MM[0] * fy - LAB_MM[1] * fx  # about the laboratory's origin
    return {"x_mm": x, "y_mm": y, "z_mm": z, "fx_N": fx, "fy_N": fy, "fz_N": fz, "tz_Nmm": tz}


FORCES = {"fx_N", "fy_N", "fz_N", "tz_Nmm"}
PLACES = {"x_mm", "y_mm", "z_mm"}
LAB = {"moves": "finger", "forces_on": "body", "axes": ("-y", "x", "z")}
WAYS = {
    "body": (BODY, {}),
    "plate": (reversed_(FORCES), {"forces_on": "body"}),
    "finger": (reversed_(PLACES), {"moves": "finger"}),
    "by time": (in_the_lab(), {**LAB, "contact_s": 0.02}),
    "by force": (in_the_lab(), {**LAB, "contact_N": 0.05}),
}


@pytest.mark.parametrize("way", WAYS)
def test_a_stroke_is_the_same_however_it_is_written(tmp_path, way):
    columns, keys = WAYS[way]
    file = written(tmp_path, **columns)
    piece = Follow(file=file, output_s=0.05, **keys)
    path = Protocol(path=(piece,)).route(4.0)
    body = np.column_stack([BODY[name] for name in ("x_mm", "y_mm", "z_mm")])
    np.testing.assert_allclose(path.start_mm, body[0], atol=1e-9)
    np.testing.assert_allclose(path.places_mm(), body, atol=1e-9)
    held = piece.model_copy(update={"hold": ("fy_N", "tz_Nmm")}).motion(np.zeros(3)).held
    assert held.at(0.3, np.zeros(4)) == pytest.approx([0.1, -0.2, 0.5, 0.4])

    trace = make_trace()
    trace["phase"] = np.where(trace["phase"] == "slide", "follow", trace["phase"])
    study = Study(
        stimulus=Plate(),
        protocol=Protocol(path=(Press(depth_mm=1), piece)),
        output=Output(measured=file),
    )
    found = {one.name: one for one in compare(study, trace)}
    assert found.keys() == FORCES
    model = compare(study, trace)[0].model
    assert len(model) == len(TIME)
    for name, one in found.items():
        np.testing.assert_allclose(one.recorded, BODY[name], atol=1e-9)
    assert load_text(tmp_path, study) == study


def load_text(folder, study):
    (folder / "study.toml").write_text(dump_study(study))
    return load_study(folder / "study.toml")


def test_a_recording_that_no_piece_follows_begins_with_its_contact(tmp_path):
    trace = make_trace()
    clock_s = trace["clock_s"][:PRESS]
    fz = trace["force_N"][:PRESS, 2]
    lab = {"z_mm": 30 - np.append(-1, trace["stimulator_mm"][:PRESS, 2]), "fz_N": -np.append(0, fz)}
    file = written(tmp_path, time_s=np.append(-0.1, clock_s) + 50, **lab)
    frame = Frame(moves="finger", forces_on="body", contact_s=50 + clock_s[0])
    study = Study(stimulus=Plate(), output=Output(measured=file, measured_frame=frame))
    check_measured(study, study.protocol.route(4.0))
    depth, force = compare(study, trace)
    assert (depth.name, force.name) == ("z_mm", "fz_N")
    assert depth.rms < 1e-9 and force.rms < 1e-9 and len(force.time_s) == PRESS
    assert load_text(tmp_path, study) == study


# --- smoothing ----------------------------------------------------------------------------------


def recording(time_s, z):
    values = np.zeros((len(time_s), 10))
    values[:, 2] = z
    return Recording(time_s, ("z_mm",), values, values)


def test_smoothing_halves_its_period_at_any_times_and_keeps_straight_lines():
    even = np.linspace(0, 4, 600)
    for time_s in (even, even + np.random.default_rng(0).uniform(-0.003, 0.003, 600)):
        inside = (time_s > 1) & (time_s < 3)
        for period_s, gain in ((0.05, 0.01), (0.2, 0.5), (1.0, 1.0)):
            wave = np.sin(2 * np.pi * time_s / period_s)
            smooth = recording(time_s, wave).smoothed(0.2).of(["z_mm"])[inside, 0]
            assert smooth.std() / wave[inside].std() == pytest.approx(gain, abs=0.03)
        line = recording(time_s, 3 * time_s - 2).smoothed(0.2)
        np.testing.assert_allclose(line.of(["z_mm"])[:, 0], 3 * time_s - 2, atol=1e-9)
    coarse = recording(TIME, TIME**2).smoothed(1e-4)  # far below the rows' distance
    np.testing.assert_allclose(coarse.smooth, coarse.values, atol=1e-6)


def test_what_smoothing_removes_is_logged_and_not_compared(tmp_path, caplog):
    caplog.set_level("INFO")
    rng, time_s = np.random.default_rng(1), np.linspace(0, 1, 400)
    noise = rng.normal(0, 0.02, (3, 400))
    depth = 1 - np.cos(2 * np.pi * time_s)
    file = written(
        tmp_path,
        time_s=time_s,
        z_mm=depth - 0.5 + noise[0],
        fz_N=(depth.clip(0.5) - 0.5) ** 2,
        fx_N=noise[1],
    )
    piece = Follow(file=file, smooth_s=0.2, contact_N=0.1)
    path = Protocol(path=(piece,)).route(4.0)
    path.announce()
    (smoothing, contact) = caplog.messages
    assert smoothing.startswith("smoothing of stroke.csv removes (rms): z_mm 0.01")
    assert "fx_N" not in smoothing and contact.startswith("contact in stroke.csv begins at 0.16")
    rough = Protocol(path=(Follow(file=file),)).route(4.0)
    ups = [np.abs(np.diff(one.places_mm()[:, 2])).sum() for one in (path, rough)]
    assert ups[0] == pytest.approx(4, rel=0.05) and ups[1] > 8
    assert np.interp(piece.recorded.contact_s, time_s, path.places_mm()[:, 2]) == pytest.approx(0)
    np.testing.assert_allclose(piece.recorded.values[:, 6], noise[1])  # as it was recorded


# --- wrong signs and other faults ---------------------------------------------------------------


def without(name):
    return {other: values for other, values in BODY.items() if other != name}


@pytest.mark.parametrize(
    ("columns", "keys", "sentence"),
    [
        (reversed_(FORCES), {}, r'the sign of fz_N is wrong.* change forces_on, which is "finger"'),
        (BODY, {"forces_on": "body"}, r'the sign of fz_N is wrong.* forces_on, which is "body"'),
        (
            reversed_(PLACES),
            {},
            r'presses, the body is -1 mm deep: change moves, which is "body", if z_mm has',
        ),
        (
            BODY,
            {"moves": "finger", "contact_N": 0.05},
            r'csv has no contact .* z_mm is wrong, change moves, which is "finger"',
        ),
        (
            in_the_lab(),
            LAB,
            r"is -20\.7 mm deep: .*; set contact_N or contact_s if it is not 0 at the first touch",
        ),
        (BODY, {"hold": ("fz_N",)}, r"fz_N .*csv goes down to 0 but is named in hold: press first"),
        (
            in_the_lab(),
            {**LAB, "contact_N": 0.2},
            r"and up to 0\.6 N: set contact_s, or contact_N to a",
        ),
        (in_the_lab(), {**LAB, "contact_s": 3}, r"contact_s is 3 but must be within .* to 0\.3 s"),
        (without("fz_N"), {"contact_N": 0.1}, r"no normal force, which contact_N needs"),
        (without("z_mm"), {}, r"no column z_mm along Z, and hold no fz_N"),
        (in_the_lab(), {**LAB, "contact_s": 0.1, "contact_N": 0.1}, r"set contact_s, or contact_N"),
        ({**BODY, "rz_deg": TIME}, {"moves": "finger"}, r'with turns moves must be "body"'),
        (BODY, {"axes": ("z", "x", "y")}, r"with tz_Nmm the last of axes must be z or -z\.$"),
    ],
)
def test_a_stroke_that_cannot_be_is_refused(tmp_path, columns, keys, sentence):
    piece = Follow(file=written(tmp_path, **columns), **keys)
    with pytest.raises(StudyError, match=sentence) as caught:
        Protocol(path=(piece,)).route(4.0)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("axes", [("x", "-y", "z"), ("x", "x", "z")])
def test_axes_have_to_be_right_handed(axes):
    with pytest.raises(ValueError, match="is not right-handed, as -y, x, z is"):
        Frame(axes=axes)


def test_a_force_against_the_motion_is_named_before_the_scan(tmp_path, caplog):
    for names, told in (({"fx_N"}, "fx_N of"), ({"fx_N", "fy_N"}, "fx_N and fy_N of"), ((), None)):
        caplog.clear()
        Follow(file=written(tmp_path, **reversed_(names))).announce()
        assert [one.startswith(f"{told} stroke.csv: against") for one in caplog.messages] == (
            [True] if told else []
        )


def test_a_column_that_falls_where_the_model_rises_is_named_after_the_scan(tmp_path):
    trace = make_trace()
    clock_s = np.linspace(0, 0.09, 30)
    fz = np.interp(clock_s, trace["clock_s"], trace["force_N"][:, 2])
    file = written(tmp_path, time_s=clock_s, fx_N=-fz)
    trace["force_N"] = trace["force_N"][:, [2, 1, 0]]
    (one,) = compare(Study(stimulus=Plate(), output=Output(measured=file)), trace)
    assert one.summary.endswith("r = -1.000, sign reversed?")
    assert "sign" not in dataclasses.replace(one, recorded=-one.recorded).summary


def test_a_frame_is_stated_once(tmp_path):
    file, frame = written(tmp_path, **BODY), Frame(forces_on="body")
    for path, output in (
        ((Follow(file=file),), Output(measured=file, measured_frame=frame)),
        ((Press(depth_mm=1),), Output(measured_frame=frame)),
    ):
        study = Study(stimulus=Plate(), protocol=Protocol(path=path), output=output)
        with pytest.raises(StudyError, match="measured_frame is only for a file"):
            check_measured(study, study.protocol.route(4.0))
