"""Images of firing in both protocols, and what they carry of a letter."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from synthetic import SPEED, make_results, make_trace

from tactile_fem.errors import StudyError
from tactile_fem.neuron import Population, Response
from tactile_fem.series import (
    RateImage,
    correlations,
    fibre_image,
    outline_image,
    population_image,
    rate_image,
)
from tactile_fem.study import Plate, Study, Text

ACROSS = np.arange(-25, 26) * 0.2
ALONG = np.arange(51) * 0.2


def image_of(rates: np.ndarray) -> RateImage:
    nothing = Response([np.empty(0)] * len(ACROSS), 0.0, ALONG[-1] / SPEED)
    return RateImage(ACROSS, ALONG, rates, nothing)


def letter(text: str) -> Text:
    return Text(text=text, start_mm=-5.0)


def test_correlation_finds_a_shifted_template():
    template = np.zeros((12, 20))
    template[4:8, 6:12] = np.arange(24).reshape(4, 6)
    moved = np.roll(template, (2, -3), axis=(0, 1))
    images = np.array([moved, 2 * moved + 5, np.ones((12, 20))])
    found = correlations(images, np.array([template, template.T.reshape(12, 20)]), (2, 3))
    assert found.shape == (3, 2)
    np.testing.assert_allclose(found[:, 0], [1.0, 1.0, 0.0], atol=1e-12)
    assert found[0, 1] < 0.99
    assert correlations(images, template[None], (1, 3))[0, 0] < 0.99


def test_outline_image_lies_on_the_outline():
    stimulus = letter("O")
    image = outline_image(stimulus, ACROSS, ALONG)

    (shape,) = stimulus.outlines()
    x, y = np.meshgrid(ACROSS, ALONG, indexing="ij")
    distance = shapely.distance(shape.boundary, shapely.points(x, y))
    np.testing.assert_allclose(image, np.exp(-0.5 * (distance / 0.3) ** 2), atol=0.11)
    with pytest.raises(StudyError, match='"plate" has no outline'):
        outline_image(Plate(), ACROSS, ALONG)


def test_an_image_of_the_outline_correlates_with_it_though_dragged_along():
    stimulus = letter("G")
    outline = outline_image(stimulus, ACROSS, ALONG)
    dragged = image_of(np.roll(100 * outline, (2, 3), axis=(0, 1)))
    assert dragged.outline_correlation(stimulus) > 0.98
    assert dragged.outline_correlation(stimulus, shift_mm=0.0) < 0.9
    assert image_of(0 * outline).outline_correlation(stimulus) == 0.0


def test_rate_image_counts_the_spikes_of_the_slide():
    time = np.linspace(-0.1, 0.5, 61)
    sed = np.outer(np.clip(time + 0.1, 0, 0.1) * 30, [0.0, 1.0, 2.0])
    image = rate_image(np.array([-1.0, 0.0, 1.0]), time, sed, SPEED, Population())
    assert all((times >= 0).all() for times in image.response.spikes)
    counted = image.rate_Hz.sum(axis=1) * 0.2 / SPEED
    np.testing.assert_allclose(counted, image.response.counts(), rtol=0.02)
    assert counted[2] > counted[1] > counted[0] == 0


def test_population_and_fibre_agree_where_every_receptor_feels_the_same_body(tmp_path, caplog):
    """A plane wave in X seen by a row of receptors, and by one receptor in shifted passes."""
    across = np.arange(-2, 3) * 1.0
    trace = make_trace(across)
    felt = np.exp(-((across - 0.5) ** 2))
    history = trace["sed_kPa"][:, 2] * 2
    trace["sed_kPa"] = np.outer(history, felt)
    population = population_image(make_results(tmp_path / "population", trace=trace))
    passes = []
    for k, x in enumerate(across[::-1]):
        one = make_trace(np.zeros(1))
        one["sed_kPa"] = history[:, None] * np.exp(-((x - 0.5) ** 2))
        study = Study(stimulus=Text(shift_mm=(-x, 0.0)))
        passes.append(make_results(tmp_path / f"pass{k}", study, one))
    fibre = fibre_image(passes)
    np.testing.assert_allclose(fibre.across_mm, population.across_mm)
    np.testing.assert_allclose(fibre.rate_Hz, population.rate_Hz, atol=1e-6)
    assert population.response.counts().sum() > 20
    beside = Study(stimulus=Text(shift_mm=(0.3, 0.0)))
    uneven = [*passes, make_results(tmp_path / "beside", beside, one)]
    with caplog.at_level("WARNING"):
        holed = fibre_image(passes[:1] + passes[2:])
    assert "no complete pass at X = 1 mm" in caplog.text
    np.testing.assert_allclose(holed.across_mm, across)
    np.testing.assert_allclose(holed.rate_Hz, fibre.rate_Hz * (across != 1)[:, None], atol=1e-9)
    for few_or_uneven in (passes[:2], [passes[0], passes[0], passes[1]], uneven):
        with pytest.raises(StudyError, match="three or more passes at equal distances"):
            fibre_image(few_or_uneven)


def test_a_population_needs_receptors_at_equal_distances(tmp_path):
    uneven = make_trace(np.array([-1.0, 0.0, 0.5, 1.0]))
    with pytest.raises(StudyError, match=r"equal distances in X: .* has 4"):
        population_image(make_results(tmp_path / "uneven", trace=uneven))
