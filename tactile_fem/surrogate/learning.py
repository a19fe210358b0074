"""From scans of a finger to its surrogate: the drag, the networks, and their errors."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from tactile_fem import Results
from tactile_fem.surrogate.drag import Drag
from tactile_fem.surrogate.fast_finger import columns_of, measures, outputs_of
from tactile_fem.surrogate.heights import HeightMap
from tactile_fem.surrogate.network import Network
from tactile_fem.surrogate.touch import WHOLE, Pad, Touch
from tactile_fem.surrogate.view import (
    FELT_SIGNS,
    WHOLE_SIGNS,
    Overview,
    View,
    mirror_of_view,
    stencil_parts,
)

Array = NDArray[Any]
logger = logging.getLogger(__name__)

# Receptors near the middle move as the skin is dragged.
_MIDDLE_MM = 2.5
_RECEPTORS = 100  # of each scan
# Lighter touches do not teach the ratios of forces: they are too rough.
_LIGHT_N = 0.01
_HIDDEN = {"felt": (128, 64), "whole": (64, 32)}
# Passes over all samples, and steps of Adam; the samples of the whole finger are fewer.
_COURSE = {"felt": ((16, 1e-3), (6, 2.5e-4), (4, 6e-5)), "whole": ((60, 1e-3), (20, 2e-4))}
_BATCH, _DECAY = 512, 1e-4


@dataclass(frozen=True)
class Lesson:
    """What a scan teaches: inputs and outputs of the networks at its steps in contact.

    Attributes
    ----------
    seen, felt
        Of receptors, (rows, receptors, inputs) and (rows, receptors, outputs).
    overview, whole
        Of the whole finger, (rows, inputs) and (rows, 4): forces over the sum of the pressures,
        and contact area in mm2.
    measures
        See `tactile_fem.surrogate.fast_finger.measures`, (rows, values).
    """

    seen: Array
    felt: Array
    overview: Array
    whole: Array
    measures: Array

    @classmethod
    def of(cls, pad: Pad, scan: Results) -> Lesson:
        """Return what a complete scan teaches."""
        trace = scan.trace
        places = trace["receptors_mm"]
        chosen = np.linspace(0, len(places) - 1, min(len(places), _RECEPTORS)).round().astype(int)
        view, overview = View.of(pad, places[chosen, :2]), Overview(pad)
        outputs = outputs_of(trace)[:, chosen]
        columns: list[list[Array]] = [[], [], [], [], []]
        for row, touch in _touches(pad, scan):
            if touch.normal_N[0] > 0:
                force = trace["force_N"][row] / touch.normal_N[0]
                taught = np.append(force, trace["contact_area_mm2"][row])
                values = (
                    view(touch)[0],
                    outputs[row],
                    overview(touch)[0],
                    taught,
                    measures(touch)[0],
                )
                for column, value in zip(columns, values, strict=True):
                    column.append(value)
        return cls(*(np.array(column, dtype=np.float32) for column in columns))


def _touches(pad: Pad, scan: Results) -> Iterator[tuple[int, Touch]]:
    """Yield the rows of a scan with the contact then."""
    trace, stimulus = scan.trace, scan.study.stimulus
    places, clock = trace["stimulator_mm"], trace["clock_s"]
    body = HeightMap.of(stimulus.body(), *pad.meets(places[:, :2]))
    touch = Touch(pad, [body], np.array([_friction(scan)]), places[:1])
    for row in range(1, len(places)):
        touch.move(places[row : row + 1], clock[row] - clock[row - 1])
        yield row, touch


def _friction(scan: Results) -> float:
    friction = scan.study.stimulus.friction
    assert isinstance(friction, float), "lessons have no law of friction"
    return friction


def with_drag(pad: Pad, scans: Sequence[Results]) -> Pad:
    """Return a pad with the drag that moves the middle of the pad most as in scans."""
    histories = [found for scan in scans if (found := _drag_history(pad, scan)) is not None]

    def error(values: Array) -> Array:
        return np.concatenate([_missed(values, *history) for history in histories])

    # Pressing moves the pad a little, too: last two values, mm per N.
    found = least_squares(error, [4.0, 1.0, 1.0, 0.0, 0.0])
    drag = Drag(*found.x[:3].tolist())
    logger.info("%s, rms error %.3f mm", drag, np.sqrt(np.mean(found.fun**2)))
    return replace(pad, drag=drag)


def _drag_history(pad: Pad, scan: Results) -> tuple[Array, ...] | None:
    """Return friction, normal forces, places of the body, and how far the pad has moved."""
    trace = scan.trace
    middle = np.hypot(*trace["receptors_mm"][:, :2].T) < _MIDDLE_MM
    if not middle.any():
        return None
    normal = np.array([0.0, *(touch.normal_N[0] for _, touch in _touches(pad, scan))])
    moved = trace["moved_mm"][:, middle, :2].mean(axis=1)
    return np.array(_friction(scan)), normal, trace["stimulator_mm"][:, :2], moved


def _missed(values: Array, friction: Array, normal: Array, places: Array, moved: Array) -> Array:
    drag, slip, missed = Drag(*values[:3]), np.zeros(2), []
    limits = drag.limit_mm(friction, normal)
    for k in range(1, len(places)):
        slip = drag.slid(slip, places[k] - places[k - 1], limits[k])
        missed.append(drag.of(slip, limits[k]) + values[3:] * normal[k] - moved[k])
    return np.concatenate(missed)


def learn_felt(lessons: Sequence[Lesson], *, is_symmetric: bool) -> Network:
    """Return the network of the receptors, learnt from scans and their mirror images, if any."""
    inputs = [lesson.seen.reshape(-1, lesson.seen.shape[-1]) for lesson in lessons]
    outputs = [lesson.felt.reshape(-1, lesson.felt.shape[-1]) for lesson in lessons]
    x, y = np.concatenate(inputs), np.concatenate(outputs)
    if is_symmetric:
        x, y = _with_mirror_images(x, y, mirror_of_view(), FELT_SIGNS)
    scale = x.std(axis=0) + 1e-3
    for part in stencil_parts():
        scale[part] = np.sqrt(np.mean(scale[part] ** 2))  # so neighbours keep their proportions
    return _learnt("felt", x, y, scale)


def learn_whole(pad: Pad, lessons: Sequence[Lesson], *, is_symmetric: bool) -> Network:
    """Return the network of the whole finger, learnt likewise."""
    normal = WHOLE.index("normal_N")
    x, y = (
        np.concatenate(
            [getattr(each, name)[each.measures[:, normal] > _LIGHT_N] for each in lessons]
        )
        for name in ("overview", "whole")
    )
    if is_symmetric:
        x, y = _with_mirror_images(x, y, Overview(pad).mirror(), WHOLE_SIGNS)
    return _learnt("whole", x, y, x.std(axis=0) + 1e-2)


def _with_mirror_images(
    x: Array, y: Array, mirror: tuple[Array, Array], signs: Array
) -> tuple[Array, Array]:
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
    for passes, step in _COURSE[name]:
        model.set_params(learning_rate_init=step, max_iter=passes, n_iter_no_change=passes)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that it has not converged: the course is fixed
            model.fit(x, y)
        logger.info("%s: rms error %.3f of the spread", name, np.sqrt(2 * model.loss_))
    return Network.scaled(model.coefs_, model.intercepts_, (middle, scale), of_outputs)


def errors_of(felt: Network, whole: Network, lessons: Sequence[Lesson]) -> Mapping[str, float]:
    """Return the errors in scans that were held out, medians of the scans.

    Normal force: mean error over the mean. SED: rms error over the largest value, and the
    correlation of the histories of receptors with a fifth of it or more.
    """
    normal, rms, likeness = [], [], []
    for lesson in lessons:
        force = whole(lesson.overview)[:, 2]
        normal.append(np.abs(force - lesson.whole[:, 2]).mean() / lesson.whole[:, 2].mean())
        found = felt(lesson.seen.reshape(-1, lesson.seen.shape[-1]))
        guess, true = (
            columns_of(values)["sed_kPa"]
            for values in (found.reshape(lesson.felt.shape), lesson.felt)
        )
        rms.append(np.sqrt(((guess - true) ** 2).mean()) / true.max())
        strong = true.max(axis=0) > 0.2 * true.max()
        pairs = zip(guess.T[strong], true.T[strong], strict=True)
        likeness.append(np.median([np.corrcoef(a, b)[0, 1] for a, b in pairs]))
    named = {"normal_force": normal, "sed_rms": rms, "sed_correlation": likeness}
    return {name: round(float(np.median(values)), 4) for name, values in named.items()}
