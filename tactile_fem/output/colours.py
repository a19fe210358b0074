"""Colours of the tissues in pictures."""

from __future__ import annotations

COLOURS = {
    "stratum_corneum": "#E7C6A5",
    "epidermis": "#A8683F",
    "dermis": "#C8553D",
    "subcutaneous": "#F2DFA7",
    "bone": "#B9C0C6",
    "nail": "#7FB0BF",
}
# No strain energy density is shown in them.
RIGID = ("bone", "nail")
