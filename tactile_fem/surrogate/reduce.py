"""Makes a fast finger: scans of random bodies, the compliance, the networks, their errors."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import interp1d
from scipy.optimize import least_squares

from tactile_fem import Results, Trace
from tactile_fem.errors import StudyError, TactileError
from tactile_fem.runtime.logs import shown
from tactile_fem.series import Member, Outcome, collected, run_series
from tactile_fem.study import Study
from tactile_fem.surrogate.compliance import pad_of
from tactile_fem.surrogate.contact import WHOLE, ContactPatch, Pad, TangentialResponse
from tactile_fem.surrogate.fast_finger import FastFinger, check_taught, is_symmetric
from tactile_fem.surrogate.heights import HeightMap
from tactile_fem.surrogate.networks import (
    FELT_SIGNS,
    WHOLE_SIGNS,
    Mirror,
    Network,
    Overview,
    View,
    mirror_of_view,
    outputs_of,
    stencil_parts,
)
from tactile_fem.surrogate.random_scans import DEEPEST_MM, TEST_KINDS, random_scan

Array = NDArray[Any]

logger = logging.getLogger(__name__)

# One scan in so many is held out, to measure the errors.
_HELD_OUT = 8
LEAST_SCANS = 2 * _HELD_OUT
_REACH_MM = 0.05  # pressed skin beyond the deepest place
_TIMES = 401  # of histories that are compared


@shown()
def reduce_finger(
    study: Study, folder: Path | str, *, scans: int = 100, jobs: int = 1, collect: bool = False
) -> FastFinger:
    """Return the surrogate of a study's finger, made from scans of random bodies.

    The scans are kept in a folder: started again, with more of them too, it goes on. Stimulus and
    protocol of the study have no effect. Raises StudyError for bad input, before anything runs, and
    TactileError if fewer than 16 scans succeeded, or scikit-learn is missing.

    Parameters
    ----------
    scans
        At least 16; some 100 are needed to reach a few per cent.
    jobs
        Scans side by side.
    collect
        Whether they have all run elsewhere.
    """
    wanted = wanted_scans(study, scans)
    outcomes = collected(wanted, folder) if collect else run_series(wanted, folder, jobs=jobs)
    return learn(study, _complete(outcomes, Path(folder)))


def wanted_scans(study: Study, scans: int) -> list[Member]:
    """Return the scans of random bodies; raise what `reduce_finger` does before anything runs."""
    check_reducible(study, scans)
    if find_spec("sklearn") is None:
        raise TactileError(
            'Reducing a finger needs scikit-learn: pip install "tactile-fem[reduce]".'
        )
    check_taught(_receptors_mm(study))
    tests = {_HELD_OUT * k: (k, TEST_KINDS[k % len(TEST_KINDS)]) for k in range(scans)}
    return [random_scan(study, *tests.get(number, (number,))) for number in range(scans)]


def check_reducible(study: Study, scans: int) -> None:
    """Raise StudyError for a finger that cannot be reduced, or too few scans."""
    if scans < LEAST_SCANS:
        raise StudyError(f"scans is {scans}; it must be {LEAST_SCANS} or more.")
    if study.finger.is_section:
        raise StudyError('finger.kind is "section"; only a solid finger can be reduced.')
    if study.joint or study.afferents:
        table = "joint" if study.joint else "afferents"
        raise StudyError(f"a finger with the table {table} cannot be reduced; leave it out.")


def learn(study: Study, scans: Sequence[Results]) -> FastFinger:
    """Return the surrogate learnt from complete scans of a study's finger, and its errors."""
    tests = [scan for scan in scans if kind_of(scan) in TEST_KINDS]
    lessons = [scan for scan in scans if kind_of(scan) not in TEST_KINDS]
    tables = study.model_dump(mode="json")
    pad, symmetric = pad_of(study, DEEPEST_MM + _REACH_MM), is_symmetric(tables)
    pad = with_drag(pad.symmetric() if symmetric else pad, lessons)
    taught = [TrainingScan.of(pad, scan) for scan in lessons]
    felt = learn_felt(taught, is_symmetric=symmetric)
    whole = learn_whole(pad, taught, is_symmetric=symmetric)
    measures = np.concatenate([each.measures for each in taught])
    finger = FastFinger(
        pad=pad,
        felt=felt,
        whole=whole,
        receptors_mm=_receptors_mm(study),
        ranges=np.array([measures.min(axis=0), measures.max(axis=0)]),
        made_from={"study": tables, "scans": [s.folder.name for s in scans]},
    )
    finger = replace(finger, errors=errors_of(finger, tests))
    logger.info("beside %d scans that were held out: %s", len(tests), finger.errors)
    return finger


def _receptors_mm(study: Study) -> Array:
    mesh = study.finger.check()
    assert mesh is not None, "this process reads the mesh"
    return study.lay_out(mesh).positions_mm


def kind_of(scan: Results) -> str:
    """Return what a scan is of: one of the `TEST_KINDS`, or a lesson."""
    return scan.folder.name.rpartition("-")[0]


def _complete(outcomes: Sequence[Outcome], folder: Path) -> list[Results]:
    found = [Results(folder / outcome.member.name) for outcome in outcomes if not outcome.problem]
    if len(found) < LEAST_SCANS:
        raise TactileError(
            f"only {len(found)} of {len(outcomes)} scans succeeded; {LEAST_SCANS} are needed."
        )
    return found


# Receptors near the middle move as the skin is dragged.
_MIDDLE_MM = 2.5
_RECEPTORS = 100  # of each scan
# Lighter touches do not teach the ratios of forces: they are too rough.
_LIGHT_N = 0.01
_HIDDEN = {"felt": (128, 64), "whole": (64, 32)}
# Passes over all samples, and steps of Adam; the samples of the whole finger are fewer.
_PASSES = {"felt": ((16, 1e-3), (6, 2.5e-4), (4, 6e-5)), "whole": ((60, 1e-3), (20, 2e-4))}
_BATCH, _DECAY = 512, 1e-4


@dataclass(frozen=True)
class TrainingScan:
    """What a scan teaches: inputs and outputs of the networks at its steps in contact."""

    seen: Array  # (rows, receptors, inputs)
    felt: Array  # (rows, receptors, outputs)
    overview: Array  # of the whole finger, (rows, inputs)
    whole: Array  # forces over the sum of the pressures, and contact area in mm2, (rows, 4)
    measures: Array  # see `ContactPatch.measures`, (rows, values)

    @classmethod
    def of(cls, pad: Pad, scan: Results) -> TrainingScan:
        """Return what a complete scan teaches."""
        trace = scan.trace
        places = trace["receptors_mm"]
        chosen = np.linspace(0, len(places) - 1, min(len(places), _RECEPTORS)).round().astype(int)
        view, overview = View.of(pad, places[chosen, :2]), Overview(pad)
        outputs = outputs_of(trace)[:, chosen]
        rows: list[tuple[Array, ...]] = []
        for row, patch in _patches(pad, scan):
            if patch.normal_N[0] > 0:
                force = trace["force_N"][row] / patch.normal_N[0]
                whole = np.append(force, trace["contact_area_mm2"][row])
                seen = view(patch)[0], outputs[row], overview(patch)[0], whole, patch.measures()[0]
                rows.append(seen)
        return cls(*(np.array(column, np.float32) for column in zip(*rows, strict=True)))


def _patches(pad: Pad, scan: Results) -> Iterator[tuple[int, ContactPatch]]:
    """Yield the rows of a scan with the contact then."""
    trace, stimulus = scan.trace, scan.study.stimulus
    places, clock = trace["stimulator_mm"], trace["clock_s"]
    body = HeightMap.of(stimulus.body(), *pad.meets(places[:, :2]))
    patch = ContactPatch(pad, [body], np.array([_friction(scan)]), places[:1])
    for row in range(1, len(places)):
        patch.move(places[row : row + 1], clock[row] - clock[row - 1])
        yield row, patch


def _friction(scan: Results) -> float:
    friction = scan.study.stimulus.friction
    assert isinstance(friction, float), "random scans have no law of friction"
    return friction


def with_drag(pad: Pad, scans: Sequence[Results]) -> Pad:
    """Return a pad with the drag that moves the middle of the pad most as in scans."""
    histories = [found for scan in scans if (found := _drag_history(pad, scan)) is not None]

    def error(values: Array) -> Array:
        return np.concatenate([_missed(values, *history) for history in histories])

    # Pressing moves the pad a little, too: last two values, mm per N.
    found = least_squares(error, [4.0, 1.0, 1.0, 0.0, 0.0])
    drag = TangentialResponse(*found.x[:3].tolist())
    logger.info("%s, rms error %.3f mm", drag, np.sqrt(np.mean(found.fun**2)))
    return replace(pad, tangential=drag)


def _drag_history(pad: Pad, scan: Results) -> tuple[Array, ...] | None:
    """Return friction, normal forces, places of the body, and how far the pad has moved."""
    trace = scan.trace
    middle = np.hypot(*trace["receptors_mm"][:, :2].T) < _MIDDLE_MM
    if not middle.any():
        return None
    normal = np.array([0.0, *(patch.normal_N[0] for _, patch in _patches(pad, scan))])
    moved = trace["moved_mm"][:, middle, :2].mean(axis=1)
    return np.array(_friction(scan)), normal, trace["stimulator_mm"][:, :2], moved


def _missed(values: Array, friction: Array, normal: Array, places: Array, moved: Array) -> Array:
    drag, slip, missed = TangentialResponse(*values[:3]), np.zeros(2), []
    limits = drag.limit_mm(friction, normal)
    for k in range(1, len(places)):
        slip = drag.slid(slip, places[k] - places[k - 1], limits[k])
        missed.append(drag.of(slip, limits[k]) + values[3:] * normal[k] - moved[k])
    return np.concatenate(missed)


def learn_felt(scans: Sequence[TrainingScan], *, is_symmetric: bool) -> Network:
    """Return the network of the receptors, learnt from scans and their mirror images, if any."""
    x = np.concatenate([scan.seen.reshape(-1, scan.seen.shape[-1]) for scan in scans])
    y = np.concatenate([scan.felt.reshape(-1, scan.felt.shape[-1]) for scan in scans])
    if is_symmetric:
        x, y = _with_mirror_images(x, y, mirror_of_view(), FELT_SIGNS)
    scale = x.std(axis=0) + 1e-3
    for part in stencil_parts():
        scale[part] = np.sqrt(np.mean(scale[part] ** 2))  # so neighbours keep their proportions
    return _learnt("felt", x, y, scale)


def learn_whole(pad: Pad, scans: Sequence[TrainingScan], *, is_symmetric: bool) -> Network:
    """Return the network of the whole finger, learnt likewise."""
    normal = WHOLE.index("normal_N")
    x, y = (
        np.concatenate([getattr(each, name)[each.measures[:, normal] > _LIGHT_N] for each in scans])
        for name in ("overview", "whole")
    )
    if is_symmetric:
        x, y = _with_mirror_images(x, y, Overview(pad).mirror(), WHOLE_SIGNS)
    return _learnt("whole", x, y, x.std(axis=0) + 1e-2)


def _with_mirror_images(x: Array, y: Array, mirror: Mirror, signs: Array) -> tuple[Array, Array]:
    order, flips = mirror
    return np.concatenate([x, x[:, order] * flips]), np.concatenate([y, y * signs])


def _learnt(name: str, x: Array, y: Array, scale: Array) -> Network:
    """Return a network trained to give `y` (n, outputs) for `x` (n, inputs), by least squares."""
    import warnings

    from sklearn.neural_network import MLPRegressor  # an extra

    middle, of_outputs = x.mean(axis=0), (y.mean(axis=0), y.std(axis=0) + 1e-6)
    x = ((x - middle) / scale).astype(np.float32)
    y = ((y - of_outputs[0]) / of_outputs[1]).astype(np.float32)
    model = MLPRegressor(
        hidden_layer_sizes=_HIDDEN[name],
        alpha=_DECAY,
        batch_size=_BATCH,
        random_state=1,
        tol=0.0,
        warm_start=True,
    )
    for passes, step in _PASSES[name]:
        model.set_params(learning_rate_init=step, max_iter=passes, n_iter_no_change=passes)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that it has not converged: their number is fixed
            model.fit(x, y)
        logger.info("%s: rms error %.3f of the spread", name, np.sqrt(2 * model.loss_))
    return Network.scaled(model.coefs_, model.intercepts_, (middle, scale), of_outputs)


def errors_of(finger: FastFinger, tests: Sequence[Results]) -> dict[str, float]:
    """Return the errors beside scans of the `TEST_KINDS`: shares, root mean squares of the scans.

    Normal force: mean error over the mean. SED: rms error over the largest value, and the
    correlation of the histories of receptors with a fifth of it or more. Rates, of each kind:
    ``rate_…``, rms error of the afferents that fire over their mean; ``mean_rate_…``, error of the
    mean of all.
    """
    found: dict[str, list[float]] = {}
    for scan in tests:
        full, body = Trace.read(scan.trace), scan.study.stimulus.body()
        path, places = scan.study.protocol.route(DEEPEST_MM), full.receptors_mm[:, :2]
        fast = finger.scan(body, path, friction=_friction(scan), receptors_mm=places)
        times = np.linspace(0.0, full.time_s[-1], _TIMES)  # means are over time, not over steps
        (force_N, sed), (true_N, true) = (
            [interp1d(one.time_s, values, axis=0)(times) for values in (one.force_N, one.sed_kPa)]
            for one in (fast, full)
        )
        strong = true.max(axis=0) > 0.2 * true.max()
        pairs = zip(sed.T[strong], true.T[strong], strict=True)
        own = {
            "normal_force": np.abs(force_N - true_N)[:, 2].mean() / true_N[:, 2].mean(),
            "sed_rms": np.sqrt(((sed - true) ** 2).mean()) / true.max(),
            "sed_correlation": np.median([np.corrcoef(a, b)[0, 1] for a, b in pairs]),
        }
        rates, true_rates = finger.mean_rates(fast), finger.mean_rates(full)
        if true_rates.any():
            fires, kind = (rates + true_rates) > 0, kind_of(scan)
            rms = np.sqrt(((rates - true_rates)[fires] ** 2).mean())
            own[f"rate_{kind}"] = rms / true_rates[fires].mean()
            own[f"mean_rate_{kind}"] = abs(rates.mean() / true_rates.mean() - 1)
        for name, value in own.items():
            found.setdefault(name, []).append(float(value))
    return {name: round(float(np.sqrt(np.mean(np.square(v)))), 4) for name, v in found.items()}
