# %% [markdown]
# # Comparison with Brian2: spike times and computing time
#
# This demo emphasizes
# - that a simulation with time steps converges to the exact spike times,
# - the cost of the same population with both.
#
# Both get the same strain energy density $D$, linear between samples, and integrate
#
# $$C \dot V = -V/R + \alpha\max(S - \kappa_f a_f - \kappa a, 0), \quad S = D^p, \quad
#   \tau_f \dot a_f = S - a_f, \quad \tau_a \dot a = S - a .$$
#
# [Brian2](https://brian2.readthedocs.io) uses steps $\Delta t$. A spike is assigned to the step in
# which $V$ crosses the threshold, and integration restarts a whole number of steps later. Each
# spike may therefore shift the following ones by a step or two, and all must converge to the exact
# ones as $\Delta t$ decreases. Where the current comes close to the rheobase, the smallest shift
# decides whether there is one more spike: 1 % of all are not counted. Both run on one core,
# without Brian2's compilation and start.
#
#     pip install brian2
#     python demos/verification/brian.py results/brian
#     python demos/verification/brian.py results/brian --afferents 20 --steps-ms 0.1

# %%
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from time import process_time

import numpy as np

from tactile_fem import run_script, write_table
from tactile_fem.neuron import Response, respond
from tactile_fem.study import Neuron

NEURON = Neuron()
_USUAL = 0.99
EQUATIONS = """
dv/dt = (-v/R + alpha*clip(s - kappa_f*a_f - kappa*a, 0, inf)) / C : volt (unless refractory)
da_f/dt = (s - a_f) / tau_f : 1
da/dt = (s - a) / tau_a : 1
s = clip(drive, 0, inf)**power : 1
drive = felt(t, i) + slope*(t - sample*int(t/sample + 1e-6)) : 1
slope = rise(t, i) : hertz
"""


@dataclass(frozen=True)
class Run:
    """One simulation with Brian2 against the exact spikes."""

    step_ms: float
    seconds: float
    spikes: int
    equal_counts: float
    first_in_steps: float
    usual_ms: float
    exact_seconds: float
    exact_spikes: int


# %%
def main(
    folder: Path,
    *,
    afferents: int = 10_000,
    duration: float = 1.0,
    sample_ms: float = 1.0,
    steps_ms: tuple[float, ...] = (0.1, 0.05),
) -> None:
    """Compare spikes and seconds; duration in s, samples and Brian2's steps in ms."""
    if not find_spec("brian2"):
        print("Brian2 is not installed: pip install brian2")
        return
    folder.mkdir(parents=True, exist_ok=True)
    time, sed = histories(afferents, duration, 1e-3 * sample_ms)
    exact_s, exact = np.inf, None
    for _ in range(3):
        start = process_time()
        exact = respond(time, sed, NEURON)
        exact_s = min(exact_s, process_time() - start)
    runs = [
        compared(step, *with_brian(time, sed, 1e-3 * step), exact, exact_s) for step in steps_ms
    ]
    write_table(folder / "brian.csv", runs)
    print(f"{afferents} afferents x {duration:g} s, samples each {sample_ms:g} ms")
    print(f"exact: {runs[0].exact_spikes} spikes in {exact_s:.2f} s")
    for r in runs:
        print(
            f"Brian2, steps of {r.step_ms:g} ms: {r.spikes} spikes in {r.seconds:.2f} s, "
            f"{r.seconds / exact_s:.1f} times as long"
        )
        print(
            f"  equal counts in {100 * r.equal_counts:.1f} % of the afferents; first spikes differ "
            f"by at most {r.first_in_steps:.2f} steps, {_USUAL:.0%} of all by at most "
            f"{r.usual_ms:.2f} ms"
        )


def histories(afferents: int, duration: float, sample: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times and SED, kPa: a ramp of 50 ms, then slow waves; as large as under the bar."""
    random = np.random.default_rng(1)
    time = sample * np.arange(round(duration / sample) + 1)
    height, frequency, phase = random.uniform((0.1, 1.0, 0.0), (0.5, 4.0, 6.3), (afferents, 3)).T
    wave = 1 + 0.3 * np.sin(2 * np.pi * frequency * time[:, None] + phase)
    return time, np.minimum(time / 0.05, 1.0)[:, None] * height * wave


# %%
def with_brian(time: np.ndarray, sed: np.ndarray, step: float) -> tuple[float, list[np.ndarray]]:
    """Return Brian2's seconds and spikes."""
    import brian2 as b

    n, sample = NEURON, (time[1] - time[0]) * b.second
    slopes = np.vstack([np.diff(sed, axis=0) / np.diff(time)[:, None], 0 * sed[:1]])
    namespace = {
        "felt": b.TimedArray(sed, dt=sample),
        "rise": b.TimedArray(slopes * b.hertz, dt=sample),
        "sample": sample,
        "R": n.resistance_GOhm * b.Gohm,
        "C": n.capacitance_pF * b.pF,
        "alpha": n.static_gain_pA_per_kPa * b.pA,
        "power": n.power,
        "kappa_f": n.fast_adaptation,
        "tau_f": n.fast_adaptation_time_s * b.second,
        "kappa": n.adaptation,
        "tau_a": n.adaptation_time_s * b.second,
        "level": n.threshold_mV * b.mV,
    }
    group = b.NeuronGroup(
        sed.shape[1],
        EQUATIONS,
        threshold="v >= level",
        reset="v = 0*mV",
        refractory=n.refractory_s * b.second,
        method="exponential_euler",
        dt=step * b.second,
        namespace=namespace,
    )
    spikes = b.SpikeMonitor(group)
    network = b.Network(group, spikes)
    network.store()
    seconds = []
    for length in (step, step, time[-1]):  # compile, start, run
        network.restore()
        begin = process_time()
        network.run(length * b.second)
        seconds.append(process_time() - begin)
    trains = spikes.spike_trains()
    times = [np.asarray(trains[k] / b.second) for k in range(sed.shape[1])]
    return seconds[2] - seconds[1], times


def compared(
    step_ms: float, seconds: float, spikes: list[np.ndarray], exact: Response, exact_s: float
) -> Run:
    """Return the errors of Brian2's spike times, in steps."""
    step = 1e-3 * step_ms
    first, near, equal = 0.0, [], 0
    for theirs, ours in zip(spikes, exact.spikes, strict=True):
        equal += len(theirs) == len(ours)
        if len(theirs) and len(ours):
            # Brian2 names a step by its begin; the crossing is within it.
            distance = np.abs(np.subtract.outer(theirs + step / 2, ours))
            first = max(first, float(distance[0, 0]) / step)
            near.append(distance.min(axis=0))
    usual = 1e3 * float(np.quantile(np.concatenate(near), _USUAL))
    total = sum(map(len, spikes)), int(exact.counts().sum())
    share = equal / len(spikes)
    return Run(step_ms, seconds, total[0], share, first, usual, exact_s, total[1])


# %%
if __name__ == "__main__":
    run_script(main)
