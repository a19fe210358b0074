"""Images of firing in both protocols, and the recognition of letters."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from firing_images import letters_figure, population_image, side_by_side, with_row_spacing
from letter_recognition import (
    Recognition,
    confusion_figure,
    correlations,
    edge_image,
    noise_of_reader,
    recognise,
)
from synthetic import SPEED, make_results, make_trace

from tactile_fem.errors import StudyError
from tactile_fem.neuron import Population, Response
from tactile_fem.series import RateImage, fibre_image, rate_image
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


def test_edge_image_lies_on_the_outline():
    stimulus = letter("O")
    image = edge_image(stimulus, ACROSS, ALONG)

    (shape,) = stimulus.outlines()
    x, y = np.meshgrid(ACROSS, ALONG, indexing="ij")
    distance = shapely.distance(shape.boundary, shapely.points(x, y))
    np.testing.assert_allclose(image, np.exp(-0.5 * (distance / 0.3) ** 2), atol=0.11)
    with pytest.raises(StudyError, match='"plate" has no outline'):
        edge_image(Plate(), ACROSS, ALONG)


def test_recognition_tells_letters_apart_and_guesses_in_noise():
    rng = np.random.default_rng(1)
    edges = {name: edge_image(letter(name), ACROSS, ALONG) for name in "CDFGHO"}

    def images(noise: float) -> dict[str, list[RateImage]]:
        return {
            name: [
                image_of(np.roll(e, k - 2, 0) + noise * rng.normal(size=e.shape)) for k in range(5)
            ]
            for name, e in edges.items()
        }

    clear = recognise(images(0.2))
    assert clear.accuracy == 1.0
    assert clear.letters == tuple("CDFGHO")
    np.testing.assert_array_equal(clear.confusion, 5 * np.eye(6, dtype=int))
    assert recognise(images(50.0)).accuracy < 0.5
    assert len(confusion_figure({"clear": {0.0: clear}}).axes) == 1
    with pytest.raises(StudyError, match="two or more images"):
        recognise({"C": images(0.0)["C"][:1]})
    with pytest.raises(StudyError, match="as many of each"):
        recognise({"C": images(0.0)["C"], "D": images(0.0)["D"][:3]})


def test_a_confusion_matrix_names_hard_letters_and_mistaken_pairs():
    confusion = np.array([[8, 2, 0], [4, 5, 1], [0, 0, 10]])
    found = Recognition(("C", "O", "H"), confusion)
    assert found.hardest() == [("O", 0.5), ("C", 0.8), ("H", 1.0)]
    assert found.mistaken() == [("CO", 0.3), ("OH", 0.05), ("CH", 0.0)]


def test_an_alphabet_is_drawn_in_several_lines():
    image = image_of(np.ones((len(ACROSS), len(ALONG))))
    names = "ABCDEFGHIJK"
    figure = letters_figure({"population": dict.fromkeys(names, image)}, dict.fromkeys(names, ()))
    panels = [axes for axes in figure.axes if axes.get_title()]
    assert [axes.get_title() for axes in panels] == list(names)
    assert len({round(axes.get_position().y0, 6) for axes in panels}) == 2


def test_the_readers_noise_is_that_which_gives_the_accuracy():
    edges = {name: 100 * edge_image(letter(name), ACROSS, ALONG) for name in "CDFGHO"}
    images = {name: [image_of(np.roll(e, k, 0)) for k in range(5)] for name, e in edges.items()}
    noise = noise_of_reader(images, 0.5)
    assert recognise(images, noise_Hz=noise).accuracy == pytest.approx(0.5, abs=1.5 / 30)
    assert recognise(images, noise_Hz=noise / 10).accuracy > 0.9
    same = {name: [image_of(edges["C"])] * 5 for name in edges}
    with pytest.raises(StudyError, match="are recognised without noise, but 50% asked for"):
        noise_of_reader(same, 0.5)


def test_noise_that_letters_share_does_not_tell_them_apart():
    """Letters that feel alike are confused as often as not, not always.

    A population has the same gains under every letter. Were its own image in the other letter's
    template only, it would be read as the other.
    """
    rng = np.random.default_rng(2)
    edges = {name: edge_image(letter(name), ACROSS, ALONG) for name in "CO"}
    noise = 2.0 * rng.normal(size=(6, *edges["C"].shape))
    mean = (edges["C"] + edges["O"]) / 2
    images = {
        name: [image_of(mean + 1e-6 * edge + own) for own in noise] for name, edge in edges.items()
    }
    assert 0.25 <= recognise(images).accuracy <= 0.75


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
    images = {"population": population, "single fibre": fibre}
    assert len(side_by_side(images).axes) == 5
    circle = 3 * np.column_stack([np.cos(across), np.sin(across)])
    letters = letters_figure(
        {name: {"O": image} for name, image in images.items()}, {"O": [circle]}
    )
    assert [len(axes.lines) for axes in letters.axes] == [1, 1, 0, 0]  # two bars of colour
    assert letters.axes[0].get_title() == "O"
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


def test_a_thinned_image_keeps_the_middle():
    rates = np.outer(ACROSS, np.ones(len(ALONG)))
    spikes = [np.full(k, 0.1) for k in range(len(ACROSS))]
    image = RateImage(ACROSS, ALONG, rates, Response(spikes, 0.0, 0.5))
    thin = with_row_spacing(image, 2.0)
    np.testing.assert_allclose(thin.across_mm, [-4, -2, 0, 2, 4], atol=1e-12)
    np.testing.assert_array_equal(thin.rate_Hz[:, 0], thin.across_mm)
    np.testing.assert_array_equal(thin.response.counts(), [5, 15, 25, 35, 45])
    np.testing.assert_array_equal(with_row_spacing(image, 0.2).rate_Hz, rates)
    for wrong in (0.1, 0.5, 6.0):
        with pytest.raises(StudyError, match=f"Rows {wrong:g} mm apart must be three or more"):
            with_row_spacing(image, wrong)
