"""A results folder without a scan: smooth made-up histories that look like one."""

from types import SimpleNamespace

import numpy as np

from tactile_fem.finger.mesh_data import TISSUES
from tactile_fem.finger.simplex import quadratic
from tactile_fem.results.fields import FieldWriter
from tactile_fem.results.results import Results
from tactile_fem.study import Finger, Study

SPEED = 20.0
PRESS, SLIDE = 8, 50
COSTS = (
    *("linear_iterations", "contact_area_mm2", "gap_error_mm", "traction_error", "volume_change"),
    *("stored_mJ", "work_mJ", "friction_mJ", "imbalance_N"),
)


def make_trace(across=np.arange(-10, 11) * 0.5):
    depth = np.concatenate([np.linspace(0, 1.97, PRESS), np.full(SLIDE, 1.97)])
    displacement = np.concatenate([np.zeros(PRESS), np.arange(1, SLIDE + 1) * 0.2])
    force = np.zeros((len(depth), 3))
    force[:, 2] = 0.6 * (depth / 1.97) ** 2
    force[:, 1] = -0.3 * force[:, 2] * (1 - np.exp(-displacement / 0.2))
    wave = 1.5 - np.cos(2 * np.pi * displacement / 5)
    height = 0.8 + across**2 / 16
    moved = np.zeros((len(depth), len(across), 3))
    moved[..., 1] = -displacement[:, None] / 10
    moved[..., 2] = 1.5 - height / 2
    clock = (depth + displacement) / SPEED
    return {
        **dict.fromkeys(COSTS, 0 * clock),
        "clock_s": clock,
        "time_s": clock - 1.97 / SPEED,
        "phase": np.repeat(["rest", "press", "slide"], [1, PRESS - 1, SLIDE]),
        "displacement_mm": displacement,
        "depth_mm": depth,
        "newton_iterations": np.full(len(depth), 5),
        "wall_s": np.full(len(depth), 0.5),
        "stimulator_mm": np.column_stack([0 * depth, -displacement, depth]),
        "force_N": force,
        "moment_Nmm": 0 * force,
        "stimulator_rad": 0 * force,
        "bone_rad": 0 * clock,
        "receptors_mm": np.column_stack([across, 0 * across, height]),
        "moved_mm": moved,
        "sed_kPa": (depth / 1.97)[:, None] * wave[:, None] * np.exp(-((across / 4) ** 2)),
    }


def refined(trace, parts=lambda k: 1 + k % 4):
    """Return a trace with the same histories in more steps: `parts` of the k-th, uneven ones."""
    where = np.concatenate(
        [k - 1 + np.linspace(0, 1, parts(k) + 1)[1:] ** 2 for k in range(1, len(trace["time_s"]))]
    )
    where = np.concatenate([[0.0], where])
    rows = np.arange(len(trace["time_s"]))

    def column(values):
        if values.dtype.kind == "U":
            return values[np.ceil(where - 1e-12).astype(int)]
        flat = values.reshape(len(rows), -1).T
        found = np.array([np.interp(where, rows, one) for one in flat]).T
        return found.reshape(len(where), *values.shape[1:])

    return {k: v if k == "receptors_mm" else column(v) for k, v in trace.items()}


def make_spikes(trace):
    """Return spike times: one per receptor at each whole displacement of 2 mm, from 1 mm on."""
    return [np.arange(1.0, 10.0, 2.0) / SPEED for _ in trace["receptors_mm"]]


def make_results(folder, study=None, trace=None):
    """Write a results folder without fields."""
    trace = trace or make_trace()
    results = Results.create(folder)
    results.save_study(study or Study())
    results.save_trace(**trace)
    results.save_spikes(make_spikes(trace), SimpleNamespace(**results.trace))
    results.save_run({"status": "complete"})
    return results


def make_fields(results, states=(0.0, 2.5, 5.0)):
    """Write fields of a block of two layers and a bone over the contact point, dragged along."""
    corners, tets, tissue = [], [], []
    names = ["epidermis", "dermis", "bone"]
    heights = [0.0, 0.5, 3.0, 5.0]
    for k, z in enumerate(heights):
        corners += [[x, y, z] for x in (-4.0, 4.0) for y in (-4.0, 4.0)]
        if k < len(names):
            box = [4 * k + i for i in (0, 1, 2, 3)] + [4 * k + 4 + i for i in (0, 1, 2, 3)]
            for a, b, c, d in ((0, 1, 3, 7), (0, 3, 2, 7), (0, 2, 6, 7), (0, 6, 4, 7)):
                tets.append([box[b], box[a], box[c], box[d]])
                tissue.append(TISSUES[names[k]])
            for a, b, c, d in ((0, 4, 5, 7), (0, 5, 1, 7)):
                tets.append([box[b], box[a], box[c], box[d]])
                tissue.append(TISSUES[names[k]])
    nodes = [list(map(float, corner)) for corner in corners]
    quadratic = []
    edges = [(0, 1), (1, 2), (2, 0), (3, 0), (2, 3), (1, 3)]
    for tet in tets:
        row = list(tet)
        for a, b in edges:
            row.append(len(nodes))
            nodes.append(list((np.array(nodes[tet[a]]) + np.array(nodes[tet[b]])) / 2))
        quadratic.append(row)
    nodes = np.array(nodes)
    writer = FieldWriter(results.fields, nodes, np.array(quadratic), tissue)
    for displacement in states:
        lift = np.zeros_like(nodes)
        lift[:, 1] = -displacement / 10
        lift[:, 2] = np.clip(1.5 - nodes[:, 2] / 2, 0, None)
        sed = np.linspace(0.01, 5, len(tets))
        writer.write(displacement / SPEED, {"displacement_mm": lift}, {"sed_kPa": sed})
    return len(tets)


def make_section(folder, states=(0.0, 2.5, 5.0)):
    """Write a results folder of a sagittal section with fields of three layers."""
    trace = make_trace()
    trace["receptors_mm"] = trace["receptors_mm"][:, [1, 0, 2]]
    results = make_results(folder, Study(finger=Finger(kind="section")), trace)
    heights = [0.0, 0.5, 3.0, 5.0]
    corners = np.array([[0.0, y, z] for z in heights for y in (-4.0, 4.0)])
    cells = [
        [2 * k + a, 2 * k + b, 2 * k + c] for k in range(3) for a, b, c in ((0, 1, 3), (0, 3, 2))
    ]
    tissue = np.repeat([TISSUES[name] for name in ("epidermis", "dermis", "bone")], 2)
    nodes, cells, _ = quadratic(corners, np.array(cells), np.array([[0, 1]]))
    writer = FieldWriter(results.fields, nodes, cells, tissue)
    for displacement in states:
        lift = np.zeros_like(nodes)
        lift[:, 1] = -displacement / 10
        lift[:, 2] = np.clip(1.5 - nodes[:, 2] / 2, 0, None)
        sed = np.linspace(0.01, 5, len(cells))
        writer.write(displacement / SPEED, {"displacement_mm": lift}, {"sed_kPa": sed})
    return results
