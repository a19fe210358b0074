"""Bands, causes and paired comparisons of people, against made-up people whose truth is known."""

import numpy as np
import pytest
from scipy.stats import norm, qmc

from tactile_fem.errors import StudyError
from tactile_fem.people.bands import bands, bands_table, people_needed
from tactile_fem.people.causes import REST, causes, causes_table
from tactile_fem.people.paired import paired

NAMES = ["a", "b", "c", "d", "e", "f"]
WEIGHTS = np.array([0.8, 0.5, 0.3, 0.0, 0.0, 0.0])
DASH = "\N{EN DASH}"


def people(n, seed=0, k=6):
    """Return scores (n, k) as an ensemble draws them."""
    return norm.ppf(qmc.Sobol(k, seed=seed).random(256)[:n])


def values_of(shares):
    return np.array([share.value for share in shares.values()])


# --- bands --------------------------------------------------------------------------------------


def number(rng, distribution, shape):
    values = rng.standard_normal(shape)
    return np.exp(0.8 * values) if distribution == "log-normal" else values


@pytest.mark.parametrize("people", [19, 20, 27, 60])
@pytest.mark.parametrize("distribution", ["normal", "log-normal"])
def test_bands_contain_another_person_with_their_probability(distribution, people):
    """As of 4000 ensembles; the quantiles of the sample would contain 80 % for 19 people."""
    rng = np.random.default_rng(7)
    own, other = number(rng, distribution, (people, 4000)), number(rng, distribution, 4000)
    found = bands(own)
    inside = ((found.low <= other) & (other <= found.high)).mean(axis=1)
    sd = np.sqrt(np.array([0.25, 0.09]) / 4000)
    assert inside == pytest.approx(np.array([0.5, 0.9]), abs=3 * sd.max())


@pytest.mark.parametrize("distribution", ["normal", "log-normal"])
def test_of_200_known_people_90_percent_lie_in_the_band(distribution):
    """The binomial deviation of 200, and as large a one of the band's ends."""
    rng = np.random.default_rng(3)
    found, known = bands(number(rng, distribution, 200)), number(rng, distribution, 200)
    inside = np.mean((found.low[1] <= known) & (known <= found.high[1]))
    assert inside == pytest.approx(0.9, abs=3 * np.sqrt(2 * 0.09 / 200))


def test_band_ends_are_ranks():
    """Of n = 19, 5 % and 95 % are the first and the last rank of 20; 25 % is the fifth."""
    found = bands(np.random.default_rng(0).permutation(np.arange(1.0, 20.0)))
    assert (found.median, *found.low, *found.high) == pytest.approx((10, 5, 1, 15, 19))
    assert found.covered == pytest.approx([0.5, 0.9]) and found.missing == 0
    assert bands(np.arange(1.0, 21.0)).low == pytest.approx([5.25, 1.05])


def test_too_few_people_have_their_range_and_its_probability():
    assert [people_needed(share) for share in (0.5, 0.9)] == [3, 19]
    found = bands([3.0, 1.0, 2.0, 7.0])
    assert (found.low[1], found.high[1]) == (1, 7)
    assert found.covered == pytest.approx([0.5, 3 / 5])
    assert bands([2.0]).covered == pytest.approx([0, 0])


def test_people_without_values_are_ignored_and_counted():
    values = np.arange(60.0).reshape(20, 3)
    values[4], values[5, 1] = np.nan, np.inf
    found = bands(values)
    assert found.missing == 1 and found.people.tolist() == [19, 18, 19]
    for k in range(3):
        own = values[np.isfinite(values[:, k]), k]
        alone = bands(own)
        assert found.median[k] == np.median(own)
        assert found.low[:, k] == pytest.approx(alone.low)
        assert found.high[:, k] == pytest.approx(alone.high)
    assert found.covered == pytest.approx([0.5, 17 / 19])
    nobody = bands(np.full((3, 2), np.nan))
    assert np.isnan([nobody.median, *nobody.low, *nobody.high]).all() and nobody.missing == 3


def test_the_table_of_bands_is_in_words():
    values = {"force (N)": [*range(1, 20), np.nan], "few": [1.0, 2.0, 3.0], "none": [np.nan]}
    assert bands_table(values) == [
        ["number", "people", "median", "50 % of people", "90 % of people"],
        ["force (N)", "19 (1 without)", "10", "5 to 15", "1 to 19"],
        ["few", "3", "2", "1 to 3", "1 to 3 (50 %)"],
        ["none", "0 (1 without)", DASH, DASH, DASH],
    ]


def test_headings_of_bands_have_the_probability_that_so_few_people_give():
    """The range of ten people contains another with 9/11, that of seven with 3/4."""
    values = np.arange(10.0)
    heading, force = bands_table({"force": values})
    assert heading[3:] == ["50 % of people", "82 % of people"]
    assert force[1:] == ["10", "4.5", "1.75 to 7.25", "0 to 9"]
    rows = bands_table({"force": values, "area": np.where(values < 3, np.nan, values)})
    assert rows[0][-1] == "82 % of people"
    assert rows[2][1:] == ["7 (3 without)", "6", "4 to 8", "3 to 9 (75 %)"]
    assert bands_table({"force": [1.0, 2.0]})[0][3:] == ["33 % of people"] * 2


# --- causes -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("n", "within"), [(20, 0.1), (64, 0.03), (200, 0.03)])
def test_shares_of_a_sum_are_its_squared_weights(n, within):
    found = causes(people(n), NAMES, people(n) @ WEIGHTS + 5)
    assert values_of(found.shares) == pytest.approx(WEIGHTS**2 / np.sum(WEIGHTS**2), abs=within)
    assert found.rest.value == pytest.approx(0, abs=1e-9)
    assert found.predicted == pytest.approx(1) and found.people == n
    assert [name for name, _ in found.ordered[:3]] == ["a", "b", "c"]


def test_shares_and_the_rest_add_up_whatever_the_sample():
    """One constant alone has all of it, though its sample is not of unit variance."""
    x = np.random.default_rng(1).standard_normal((15, 2))
    found = causes(x, ["a", "b"], 3 * x[:, 0])
    assert values_of(found.shares) == pytest.approx([1, 0], abs=1e-9)


def test_what_acts_jointly_is_the_rest():
    """First-order indices of a + b + ab are a third each; of ab alone, none."""
    x = people(128)
    found = causes(x, NAMES, x[:, 0] + x[:, 1] + x[:, 0] * x[:, 1])
    assert values_of(found.shares) == pytest.approx([1 / 3, 1 / 3, 0, 0, 0, 0], abs=0.06)
    assert found.rest.value == pytest.approx(1 / 3, abs=0.08)
    assert causes(x, NAMES, x[:, 0] * x[:, 1]).rest.low > 0.6


def test_a_square_is_found_by_a_higher_degree():
    """Of a + b^2, whose variances are 1 and 2: a straight line finds none of the second."""
    x = people(64, k=2)
    found = causes(x, ["a", "b"], x[:, 0] + x[:, 1] ** 2)
    assert values_of(found.shares) == pytest.approx([1 / 3, 2 / 3], abs=0.1)
    assert found.degree >= 2 and found.rest.value < 1e-9


def test_shares_of_a_product_of_factors():
    """Of exp(w x): (exp(w_i^2) - 1) / (exp(sum w^2) - 1)."""
    w = 0.5 * WEIGHTS
    found = causes(people(200), NAMES, np.exp(people(200) @ w))
    expected = np.expm1(w**2) / np.expm1(np.sum(w**2))
    assert values_of(found.shares) == pytest.approx(expected, abs=0.07)
    assert found.rest.value == pytest.approx(1 - expected.sum(), abs=0.04)


def test_what_the_polynomials_miss_is_not_ascribed():
    """Ishigami's function: indices of 31, 44 and 0 %, of functions that oscillate; 24 % jointly."""
    x = people(200, k=3)
    a, b, c = (2 * norm.cdf(x) - 1).T * np.pi
    found = causes(x, ["a", "b", "c"], np.sin(a) + 7 * np.sin(b) ** 2 + 0.1 * c**4 * np.sin(a))
    assert (values_of(found.shares) < np.array([0.314, 0.442, 0]) + 0.05).all()
    assert found.shares["a"].low > 0.03 and found.rest.value > 0.244


def test_noise_is_the_rest_and_its_intervals_contain_the_truth():
    """Of 30 ensembles of 24 people 95 % should; a nominal 80 % of the six shares must."""
    expected, hits, mean = np.append(WEIGHTS**2, 0.25) / (np.sum(WEIGHTS**2) + 0.25), [], []
    for seed in range(30):
        x, noise = people(24, seed), np.random.default_rng(seed).standard_normal(24)
        found = causes(x, NAMES, x @ WEIGHTS + 0.5 * noise)
        each = [*found.shares.values(), found.rest]
        hits.append([e.low <= truth <= e.high for e, truth in zip(each, expected, strict=True)])
        mean.append([e.value for e in each])
    assert np.mean(hits, axis=0).min() > 0.8
    assert np.mean(mean, axis=0) == pytest.approx(expected, abs=0.05)


def test_no_cause_is_found_in_noise():
    found = causes(people(20), NAMES, np.random.default_rng(2).standard_normal(20))
    assert found.predicted < 0.2 and found.rest.high > 0.8
    assert max(share.low for share in found.shares.values()) < 0.1


@pytest.mark.parametrize(("n", "within"), [(24, 0.1), (64, 0.05), (500, 0.03)])
@pytest.mark.parametrize("r", [0.9, -0.9])
def test_a_correlated_score_counts_for_what_it_adds_to_those_before(r, n, within):
    """y = a - b/2 is (1 - r/2) of the first draw less sqrt(1 - r^2)/2 of the second: 86 and 14 %

    for r = 0.9. Others vary independently: they keep theirs, here a third of the variance.
    """
    x = people(n, k=3) if n <= 256 else np.random.default_rng(0).standard_normal((n, 3))
    x[:, 1] = r * x[:, 0] + np.sqrt(1 - r**2) * x[:, 1]
    own = np.array([(1 - r / 2) ** 2, (1 - r**2) / 4])
    y = x[:, 0] - x[:, 1] / 2 + np.sqrt(own.sum() / 2) * x[:, 2]
    found = causes(x, ["a", "b", "c"], y)
    assert values_of(found.shares) == pytest.approx([*own / own.sum() * 2 / 3, 1 / 3], abs=within)
    alone = causes(x[:, :2], ["a", "b"], x[:, 0] - x[:, 1] / 2)
    assert values_of(alone.shares) == pytest.approx(own / own.sum(), abs=within)
    assert values_of(alone.shares).sum() == pytest.approx(1) and found.rest.value < 1e-9
    if r > 0:
        assert own / own.sum() == pytest.approx([0.864, 0.136], abs=1e-3)


def test_scores_that_are_equal_or_do_not_vary_add_nothing():
    x = people(64, k=2)
    x = np.column_stack([x, x[:, 0], np.full(64, 0.3)])
    found = causes(x, ["a", "b", "a again", "same"], x[:, :2] @ [1.0, 1.0])
    assert values_of(found.shares) == pytest.approx([0.5, 0.5, 0, 0], abs=0.03)
    assert found.shares["same"].high == pytest.approx(0, abs=1e-9) and found.rest.value < 1e-9


@pytest.mark.parametrize(("n", "known"), [(8, True), (12, True), (20, False), (64, False)])
def test_few_independent_scores_are_not_taken_for_correlated_ones(n, known):
    """The last score alone: what those before it share with it by chance is not theirs."""
    for seed in range(20):
        x = people(n, seed)
        found = causes(x, NAMES, x[:, 5], independent=known)
        assert found.shares["f"].value == pytest.approx(1, abs=1e-9)


def test_counts_with_ties_have_causes():
    x = people(64)
    found = causes(x, NAMES, np.round(2 * x @ WEIGHTS))
    assert values_of(found.shares) == pytest.approx(WEIGHTS**2 / np.sum(WEIGHTS**2), abs=0.1)


def test_people_without_values_are_left_out_of_causes():
    x = people(32)
    y = x @ WEIGHTS
    y[3], x[5, 2] = np.nan, np.inf
    found = causes(x, NAMES, y)
    assert (found.people, found.missing) == (30, 2)
    assert found.shares == causes(np.delete(x, [3, 5], 0), NAMES, np.delete(y, [3, 5])).shares
    assert causes_table({"force": found})[1][1] == "30 (2 without)"


def test_equal_values_have_no_causes():
    found = causes(people(16), NAMES, np.full(16, 0.1))
    assert np.isnan(values_of(found.shares)).all() and np.isnan(found.rest.value)
    assert causes_table({"x": found})[1] == ["x", "16", *[DASH] * 5]


def test_the_table_of_causes_has_the_largest_three():
    heading, row = causes_table({"force": causes(people(32), NAMES, people(32) @ WEIGHTS)})
    assert heading == ["number", "people", "cause 1", "cause 2", "cause 3", REST, "predicted"]
    assert [cell[0] for cell in row[2:5]] == ["a", "b", "c"]
    assert row[0] == "force" and row[5].startswith("0 % (0 to 0)") and row[6] == "100 %"


def test_too_few_people_for_causes_are_refused_in_a_sentence():
    sentence = r"^There are values of 7 people but .* need 8 or more, for 6 constants\.$"
    for n, y in ((7, np.arange(7.0)), (8, [np.nan, *range(7)])):
        with pytest.raises(StudyError, match=sentence):
            causes(people(n), NAMES, y)
    assert causes(people(8), NAMES, np.arange(8.0)).degree == 1
    with pytest.raises(StudyError, match=r"shape \(8, 6\) but need .* of 7 people"):
        causes(people(8), NAMES, np.arange(7.0))


# --- paired -------------------------------------------------------------------------------------


def test_paired_numbers_by_hand():
    """Ten people, one of whom declines: p = 2 (1 + 1) / 2^10, the least rank being negative."""
    first = np.full(10, 2.0)
    change = np.array([-1, 2, 3, 4, 5, 6, 7, 8, 9, 10.0])
    found = paired([*first, np.nan, 1.0], [*(first + change), 1.0, np.inf])
    assert (found.people, found.missing) == (10, 2)
    assert found.difference.value == 5.5 and found.ratio.value == 1 + 5.5 / 2
    # Ranks 2 and 9 of 10: 2 * (1 + 10) / 1024 = 2.1 %; ranks 3 and 8 would be left by 10.9 %.
    assert (found.difference.low, found.difference.high) == (2, 9)
    assert found.same.value == 0.9
    assert (found.same.low, found.same.high) == pytest.approx((0.555, 0.9975), abs=1e-3)
    assert found.p == pytest.approx(4 / 1024)
    assert str(found) == (
        "difference 5.5 (2 to 9), ratio 3.75 (2 to 5.5); the same sign in 9 of 10 people "
        "(90 %, 55 to 100 %), 2 left out; p = 0.0039"
    )


def test_ties_have_another_sign_and_zeros_a_ratio_of_one():
    found = paired([0, 0, 2, 4, 1, 1, 1], [0, 3, 2, 5, 2, 3, 4])
    assert found.same.value == pytest.approx(5 / 7)
    assert found.ratio.value == 2  # of 1, inf, 1, 1.25, 2, 3, 4
    equal = paired([1, 2, 3], [1, 2, 3])
    assert (equal.difference.value, equal.same.value, equal.p) == (0, 0, 1)


def test_negative_numbers_have_no_ratio_and_few_people_no_interval():
    found = paired([-1, 2], [2, 3])
    assert np.isnan(found.ratio.value) and found.difference.value == 2
    assert (found.difference.low, found.difference.high) == (-np.inf, np.inf)
    assert "difference 2 (fewer than 6 people); the same sign in 2 of 2" in str(found)
    six = paired(np.zeros(6), np.arange(6.0))
    assert (six.difference.low, six.difference.high) == (0, 5)


def test_the_interval_of_the_median_contains_that_of_all_people():
    rng = np.random.default_rng(5)
    inside = []
    for _ in range(200):
        found = paired(np.zeros(20), np.exp(rng.standard_normal(20))).difference
        inside.append(found.low <= 1 <= found.high)
    assert np.mean(inside) > 0.95 - 3 * np.sqrt(0.05 * 0.95 / 200)


def test_bad_people_are_refused_in_a_sentence():
    for call, sentence in (
        (lambda: bands([]), r"^Bands need the values of one person or more, but there are none\.$"),
        (lambda: bands([1.0], [1.0]), r"^The share of a band is 1 but must lie between 0 and 1\.$"),
        (lambda: paired([1, 2], [1]), r"there are 2 first and 1 second ones\.$"),
        (lambda: paired([np.nan], [1]), r"a person with both values, but nobody has\.$"),
    ):
        with pytest.raises(StudyError, match=sentence):
            call()
