"""Recorded responses of afferents to vibration and ramps; all but Talbot's read by third parties.

Monkeys: rates under a probe of 1 mm (Muniak et al. 2007, PMC6673240), thresholds of the same kind
of recording, of which the shape alone counts, and entrainment (Talbot et al. 1968). Humans: spikes
per cycle (Johansson et al. 1982) and ramps.
"""

from __future__ import annotations

# Mean spikes/s of afferents: amplitudes in um and rates, by kind and frequency in Hz.
RATES: dict[str, dict[float, list[tuple[float, float]]]] = {
    "SA1": {
        20: [(49, 4), (92, 10), (183, 18), (251, 25)],
        50: [(77, 6), (168, 30), (251, 48)],
        100: [(82, 9), (194, 48)],
    },
    "RA": {
        20: [(24, 4), (67, 24), (251, 53)],
        50: [(16, 3), (36, 23), (77, 57), (251, 103)],
        100: [(15, 6), (36, 41), (82, 111), (194, 159)],
        300: [(31, 51), (50, 188)],
    },
    "PC": {
        50: [(4.8, 16), (11, 32), (24, 47), (50, 74), (248, 100)],
        100: [(0.8, 16), (1.8, 41), (4.3, 76), (10, 100), (54, 137)],
        300: [(0.17, 18), (0.43, 62), (1.1, 112), (2.9, 170), (7.5, 238)],
    },
}
# By kind and frequency in Hz, um.
THRESHOLDS_UM = {
    "RA": {1: 507, 4: 128, 16: 53, 33: 47, 67: 55},
    "PC": {20: 6.0, 41: 1.4, 82: 0.32, 153: 0.087, 250: 0.052, 422: 0.054, 822: 0.19},
}
# One RA afferent at 40 Hz: amplitudes in um and spikes per cycle.
ENTRAINMENT_HZ = 40.0
ENTRAINMENT = [(8, 0.18), (20, 0.69), (28, 1.0), (66, 1.0), (156, 1.0), (191, 1.6), (209, 1.97)]
# Mean spikes per cycle of human afferents at 125 um, by kind and frequency in Hz, under a probe of
# 6 mm that is 0.6 mm deep. Whether 6 mm is its radius is unclear.
CYCLES_UM, CYCLES_DEPTH_MM, CYCLES_RADII_MM = 125.0, 0.6, (3.0, 6.0)
CYCLES: dict[str, dict[float, float]] = {
    "SA1": {1: 2.1, 4: 1.5, 16: 0.66, 32: 0.39, 64: 0.30},
    "RA": {1: 0.19, 4: 1.0, 16: 1.1, 32: 0.92, 64: 0.75},
    "PC": {1: 0.02, 4: 0.08, 16: 1.5, 32: 2.2, 64: 2.2},
}
# A human RA afferent in ramps of 1 mm: speed in mm/s, spikes, shortest interval in ms.
RAMPS = [
    (60.6, 4, 3.5),
    (46.5, 4, 4.2),
    (34.0, 5, 3.8),
    (20.6, 5, 5.7),
    (14.8, 4, 11.0),
    (9.5, 4, 16.0),
]
RAMPS_MM = 1.0
