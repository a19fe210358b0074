"""A small network of layers, evaluated with NumPy alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


@dataclass(frozen=True)
class Network:
    """Layers of ``max(0, x W + b)``, the last without the maximum.

    Inputs are taken less their `middle` and over their `scale`; outputs are multiplied and shifted
    likewise. Both are folded into the first and the last layer.

    Attributes
    ----------
    weights, biases
        An array for each layer, (inputs, outputs) and (outputs,).
    """

    weights: tuple[Array, ...]
    biases: tuple[Array, ...]

    @classmethod
    def scaled(
        cls,
        weights: Sequence[Array],
        biases: Sequence[Array],
        inputs: tuple[Array, Array],
        outputs: tuple[Array, Array],
    ) -> Self:
        """Return layers trained on scaled numbers; `inputs` and `outputs` are (middle, scale)."""
        w = [np.array(each, dtype=float) for each in weights]
        b = [np.array(each, dtype=float) for each in biases]
        middle, scale = inputs
        w[0] = w[0] / scale[:, None]
        b[0] = b[0] - middle @ w[0]
        middle, scale = outputs
        w[-1], b[-1] = w[-1] * scale, b[-1] * scale + middle
        return cls(*(tuple(each.astype(np.float32) for each in layers) for layers in (w, b)))

    def __call__(self, x: Array) -> Array:
        """Return the outputs (n, outputs) of inputs (n, inputs)."""
        *hidden, last = zip(self.weights, self.biases, strict=True)
        for W, b in hidden:
            x = x @ W
            x += b
            np.maximum(x, 0, out=x)
        return x @ last[0] + last[1]

    def mirrored_mean(
        self, x: Array, mirror: tuple[NDArray[np.int64], Array], signs: Array
    ) -> Array:
        """Return the mean of outputs and of those of mirrored inputs, which `signs` mirror back."""
        order, flips = mirror
        return (self(x) + signs * self(x[:, order] * flips)) / 2

    def arrays(self, name: str) -> dict[str, Array]:
        """Return its arrays to save, by names that begin with its own."""
        layers = enumerate(zip(self.weights, self.biases, strict=True))
        return {
            f"{name}_{kind}{k}": array
            for k, pair in layers
            for kind, array in zip("wb", pair, strict=True)
        }

    @classmethod
    def read(cls, name: str, saved: Mapping[str, Array]) -> Self:
        """Return the network that was saved under a name."""
        count = sum(key.startswith(f"{name}_w") for key in saved)
        weights, biases = (tuple(saved[f"{name}_{kind}{k}"] for k in range(count)) for kind in "wb")
        return cls(weights, biases)
