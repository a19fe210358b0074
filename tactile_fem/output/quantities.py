"""Fields that pictures, films and maps show: one registry of their names, labels and colours."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import Colormap, ListedColormap, LogNorm, Normalize
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.output.annotations import BLUE, COLOURS, SCALE, VERMILION
from tactile_fem.results.contact_fields import ON_SKIN
from tactile_fem.results.surfaces import components

Array = NDArray[np.floating]
Limits = tuple[float, float]

# The colours end at these percentiles of the tissue's values: at edges, SED is singular.
_PERCENTILES = [0.2, 99.8]
# Of skin, what is below this share of the largest value has the colour of skin.
_BARE_SHARE = 0.01


@dataclass(frozen=True)
class Quantity:
    """A field of numbers (n,), `of` the values (n, ...) of a kept `column` of fields.

    Its `label` has name and unit. Colours begin at `least`, None being the least value, and are
    logarithmic within the tissue if `is_log`; `categories` have a colour for each value 0, 1, ...
    """

    label: str
    column: str
    of: Callable[[Array], Array] = np.asarray
    least: float | None = 0.0
    is_log: bool = False
    categories: Mapping[str, str] = field(default_factory=dict)

    @property
    def is_on_skin(self) -> bool:
        """Whether it is one of the skin alone."""
        return self.column in ON_SKIN

    def limits(self, values: Array) -> Limits:
        """Return the ends of one colour scale for all states, values (states, n).

        They are symmetric about 0 if values have both signs.
        """
        if self.categories:
            return 0.0, len(self.categories) - 1.0
        shares = [0, 100] if self.is_on_skin else _PERCENTILES
        lows, highs = np.percentile(values, shares, axis=1)
        low, high = float(lows.min()), float(highs.max())
        if self.least is not None:
            low = self.least
        elif low < 0 < high:
            low, high = -max(-low, high), max(-low, high)
        return low, max(high, low + 1e-6)

    def scale(self, limits: Limits) -> Normalize:
        """Return the scale between two ends, within the tissue."""
        low, high = limits
        if self.is_on_skin:
            low = max(low, _BARE_SHARE * high)
        return LogNorm(low or high / 1000, high) if self.is_log else Normalize(low, high)

    def colours(self, limits: Limits) -> Colormap:
        """Return the colours: those of the categories, or a map that diverges from 0."""
        if self.categories:
            return ListedColormap(list(self.categories.values()))
        found = colormaps["RdBu_r" if limits[0] == -limits[1] else SCALE]
        return found.with_extremes(under=COLOURS["stratum_corneum"]) if self.is_on_skin else found


_length = partial(np.linalg.norm, axis=-1)


def _von_mises(stress: Array) -> Array:
    xx, yy, zz, *shear = stress.T
    apart = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
    return np.sqrt(apart / 2 + 3 * np.square(shear).sum(axis=0))


_CONTACT = {"no contact": COLOURS["stratum_corneum"], "sticks": BLUE, "slips": VERMILION}
QUANTITIES = {
    "sed": Quantity("Strain energy density (kPa)", "sed_kPa", is_log=True),
    "displacement": Quantity("Displacement (mm)", "displacement_mm", _length),
    "stretch": Quantity("Largest stretch", "stretches", lambda of: of[:, -1], least=1.0),
    "von_mises": Quantity("Von Mises stress (kPa)", "stress_kPa", _von_mises),
    "pressure": Quantity("Contact pressure (kPa)", "contact_pressure_kPa"),
    "friction": Quantity("Friction (kPa)", "friction_kPa", _length),
    "slip": Quantity("Contact", "contact", categories=_CONTACT),
}


def quantity_of(name: str, columns: Mapping[str, Array], of: str) -> Quantity:
    """Return a quantity by its name, or that of a column of fields or of one of its components.

    StudyError says that there is none, `of` what.
    """
    known = {key: one for key, one in QUANTITIES.items() if one.column in columns}
    if name.lower() in known:
        return known[name.lower()]
    for column, values in columns.items():
        if name in components({column: values}):  # or the column itself, if it has no components
            own = (one for one in known.values() if one.column == name)
            component = partial(_component, column, name)
            return next(own, Quantity(_label(name), column, component, least=None))
    choices = ", ".join([*components(columns), *known])
    raise StudyError(f"{name} is no column of {of}: choose {choices}.")


def around_corners(values: Array, facets: NDArray[np.integer]) -> Array:
    """Return the part of each triangle or line (k, d) that is nearest to each of its corners.

    Parts are polygons, (k d, 4 or 2, ...), whose corners have means of the `values` (n, ...), such
    as their places: so a category is shown without one between it and the next.
    """
    at = values[facets]
    after, before = ((at + np.roll(at, shift, axis=1)) / 2 for shift in (-1, 1))
    middle = np.broadcast_to(at.mean(axis=1, keepdims=True), at.shape)
    corners = [at, after] if facets.shape[1] == 2 else [at, after, middle, before]
    return np.stack(corners, axis=2).reshape(-1, len(corners), *values.shape[1:])


def _component(column: str, name: str, values: Array) -> Array:
    return components({column: values})[name]


def _label(column: str) -> str:
    """Return the name of a column as it is written: contact pressure (kPa)."""
    name, _, unit = column.rpartition("_")
    if unit not in ("mm", "mm2", "kPa"):
        return column.replace("_", " ").capitalize()
    return f"{name.replace('_', ' ').capitalize()} ({unit.replace('2', '²')})"
