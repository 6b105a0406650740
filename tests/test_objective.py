"""The objectives on three faces and two sensors by hand, and what must hold for any map."""

import math

import numpy as np
import pytest

from glvis.problem.objective import OVERLAP_WEIGHTS, TERM_WEIGHTS, Objective

# Two sensors and three faces: the first sees faces 0 and 1, the second face 1.
COUNTS = np.array([1, 2, 0])
AREA = np.array([2.0, 1.0, 5.0])


def paper(**settings):
    """Return an objective that counts faces, OF3 unless told otherwise."""
    return Objective(**({"kind": "of3", "by_area": False} | settings))


def value(counts=COUNTS, area=AREA, **settings):
    return paper(**settings).terms(counts, area)["value"]


# --- by hand


def test_without_a_word_the_share_of_the_area_counts_and_further_views_cost_nothing():
    assert Objective().terms(COUNTS, AREA)["value"] == pytest.approx(3 / 8)
    assert Objective().terms([9, 2, 0], AREA)["value"] == pytest.approx(3 / 8)


def test_raw_terms_of_three_faces_and_two_sensors():
    terms = paper(normalize=False).terms(COUNTS, AREA)
    assert terms["t_tot"] == 3  # 2 + 1, Eq. (6)
    assert terms["of1"] == pytest.approx(2 / 3)  # Eq. (1)
    assert terms["of2"] == 1 * 1 + 10 * 1  # Eq. (4), Table 1
    assert terms["of3"] == 1 * 3 + 2 * 2 + 1 * 11  # Eq. (5), Table 2, OF1 as a count
    assert terms["value"] == terms["of3"]


def test_normalised_terms_are_the_raw_ones_divided_by_the_number_of_faces():
    terms = paper().terms(COUNTS, AREA)
    assert terms["t_tot"] == pytest.approx(3 / 3)
    assert terms["of1"] == pytest.approx(2 / 3)
    assert terms["of2"] == pytest.approx(11 / 3)
    assert terms["of3"] == pytest.approx(18 / 3)


def test_terms_by_area():
    raw = paper(by_area=True, normalize=False).terms(COUNTS, AREA)
    assert raw["t_tot"] == 1 * 2 + 2 * 1
    assert raw["of1"] == pytest.approx(3 / 8)  # Eq. (3) over the total area
    assert raw["of2"] == 1 * 2 + 10 * 1
    assert raw["of3"] == 4 + 2 * 3 + 12
    normalised = paper(by_area=True).terms(COUNTS, AREA)
    for term in ("t_tot", "of2", "of3"):
        assert normalised[term] == pytest.approx(raw[term] / 8)
    assert normalised["of1"] == raw["of1"]


@pytest.mark.parametrize("kind", ["of1", "of2", "of3"])
def test_kind_names_the_term_that_is_maximised(kind):
    terms = paper(kind=kind).terms(COUNTS, AREA)
    assert terms["value"] == terms[kind]


@pytest.mark.parametrize(
    ("name", "weights"),
    [("set1", (1, 10, 10, -2, -4, -8)), ("set2", (10, 10, 10, -5, -10, -10))],
)
def test_overlap_weights_are_those_of_table_1(name, weights):
    overlap = OVERLAP_WEIGHTS[name]
    assert set(OVERLAP_WEIGHTS) == {"set1", "set2"}
    for seen_by, weight in enumerate(weights, start=1):
        got = value(np.array([seen_by]), kind="of2", overlap=overlap, normalize=False)
        assert got == weight
    # w_6k holds from six on
    for seen_by in (7, 8, 40):
        got = value(np.array([seen_by]), kind="of2", overlap=overlap, normalize=False)
        assert got == weights[-1]


@pytest.mark.parametrize(("name", "weights"), [("set1", (1, 2, 1)), ("set2", (1, 2, 3))])
def test_term_weights_are_those_of_table_2(name, weights):
    assert set(TERM_WEIGHTS) == {"set1", "set2"}
    w_tot, w_of1, w_of2 = TERM_WEIGHTS[name]
    objective = paper(w_tot=w_tot, w_of1=w_of1, w_of2=w_of2, normalize=False)
    assert objective.terms(COUNTS, AREA)["of3"] == np.dot(weights, (3, 2, 11))


def test_defaults_are_the_set_that_served_the_paper_best():
    default = paper()
    assert (default.w_tot, default.w_of1, default.w_of2) == TERM_WEIGHTS["set1"]
    assert default.overlap == OVERLAP_WEIGHTS["set1"]


def test_short_overlap_table_goes_on_with_its_last_weight():
    assert value(np.array([1, 2, 3, 9]), kind="of2", overlap=(5.0,), normalize=False) == 20


def test_nothing_seen_is_worth_nothing():
    terms = paper().terms(np.zeros(4, dtype=int), np.ones(4))
    assert set(terms.values()) == {0.0}


def test_a_model_without_faces_or_area_is_refused():
    with pytest.raises(ValueError, match=r"the model has no face \(or no area\) to see"):
        paper().terms(np.zeros(0, dtype=int), np.zeros(0))
    with pytest.raises(ValueError, match=r"the model has no face \(or no area\) to see"):
        paper(by_area=True).terms(COUNTS, np.zeros(3))


# --- over models


def test_models_are_averaged_or_judged_by_the_worst():
    values = np.array([[1.0, 2.0, 6.0, 3.0], [4.0, 4.0, 4.0, 0.0]])
    np.testing.assert_allclose(paper().aggregated(values), [3, 3])
    np.testing.assert_allclose(paper(aggregate="min").aggregated(values), [1, 0])
    np.testing.assert_allclose(paper(aggregate="cvar").aggregated(values), [1.5, 2])
    for fraction, expected in ((0.01, [1, 0]), (0.3, [1.5, 2]), (1.0, [3, 3])):
        cvar = paper(aggregate="cvar", cvar_fraction=fraction)
        np.testing.assert_allclose(cvar.aggregated(values), expected)


@pytest.mark.parametrize("aggregate", ["mean", "min", "cvar"])
def test_one_model_is_its_own_aggregate(aggregate):
    np.testing.assert_array_equal(paper(aggregate=aggregate).aggregated([[7.5]]), [7.5])


# --- what must hold for any map


def random_maps(rng, sensors=6, faces=40):
    return rng.random((sensors, faces)) < rng.uniform(0.1, 0.9), rng.uniform(0.1, 3, faces)


@pytest.mark.parametrize("by_area", [False, True])
@pytest.mark.parametrize("kind", ["of1", "of2", "of3"])
def test_terms_match_the_equations_read_face_by_face(rng, kind, by_area):
    for _ in range(20):
        visible, area = random_maps(rng, 8)
        weight = area if by_area else np.ones(40)
        w_tot, w_of1, w_of2, *overlap = rng.normal(size=9)
        t_tot = sum(weight[row].sum() for row in visible)
        union = weight[np.logical_or.reduce(visible)].sum()
        k = visible.sum(axis=0)
        of2 = sum(w * overlap[min(n, 6) - 1] for n, w in zip(k, weight, strict=True) if n)
        expected = {
            "of1": union / weight.sum(),
            "of2": of2,
            "of3": w_tot * t_tot + w_of1 * union + w_of2 * of2,
        }[kind]
        got = value(
            k,
            area,
            kind=kind,
            by_area=by_area,
            normalize=False,
            w_tot=w_tot,
            w_of1=w_of1,
            w_of2=w_of2,
            overlap=tuple(overlap),
        )
        assert got == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_adding_a_sensor_never_lowers_of1(seed):
    visible, area = random_maps(np.random.default_rng(seed))
    for by_area in (False, True):
        of1 = [value(visible[:n].sum(axis=0), area, kind="of1", by_area=by_area) for n in range(7)]
        assert np.all(np.diff(of1) >= -1e-12)
        assert of1[0] == 0
        assert 0 < of1[-1] <= 1 + 1e-12


@pytest.mark.parametrize("seed", range(20))
def test_permuting_sensors_or_faces_leaves_every_objective_alone(seed):
    rng = np.random.default_rng(seed)
    visible, area = random_maps(rng)
    order = rng.permutation(40)
    for kind in ("of1", "of2", "of3"):
        for by_area in (False, True):
            settings = {"kind": kind, "by_area": by_area}
            plain = value(visible.sum(axis=0), area, **settings)
            assert value(rng.permutation(visible).sum(axis=0), area, **settings) == plain
            permuted = value(visible[:, order].sum(axis=0), area[order], **settings)
            assert permuted == pytest.approx(plain, rel=1e-12)


@pytest.mark.parametrize("seed", range(20))
def test_normalised_value_does_not_change_when_every_face_is_halved(seed):
    visible, area = random_maps(np.random.default_rng(seed))
    counts = visible.sum(axis=0)
    for by_area in (False, True):
        whole = value(counts, area, by_area=by_area)
        halves = value(np.repeat(counts, 2), np.repeat(area / 2, 2), by_area=by_area)
        assert halves == pytest.approx(whole)


@pytest.mark.parametrize("overlap", [*OVERLAP_WEIGHTS.values(), (-1.0, -2.0)])
@pytest.mark.parametrize("kind", ["of1", "of2", "of3"])
def test_no_map_exceeds_the_upper_bound_and_one_attains_it(rng, kind, overlap):
    objective = paper(kind=kind, overlap=overlap)
    bound = objective.upper_bound
    for _ in range(50):
        visible, area = random_maps(rng, len(overlap))
        assert objective.terms(visible.sum(axis=0), area)["value"] <= bound + 1e-12
    attained = [
        objective.terms(np.full(10, k), np.ones(10))["value"] for k in range(len(overlap) + 1)
    ]
    assert max(attained) == pytest.approx(bound)


@pytest.mark.parametrize(
    ("settings", "label"),
    [({}, "OF1 by area"), ({"kind": "of3"}, "OF3 by area"), ({"by_area": False}, "OF1")],
)
def test_values_are_called_by_kind_and_by_what_weighs(settings, label):
    assert Objective(**settings).label == label


def test_upper_bound_of_the_arm_study_is_15_and_raw_counts_have_none():
    assert paper().upper_bound == 3 + 2 + 10
    assert paper(kind="of2").upper_bound == 10
    assert paper(kind="of1", normalize=False).upper_bound == 1
    assert paper(normalize=False).upper_bound == math.inf


# --- refusals


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"kind": "of4"}, "kind = 'of4' must be one of of1, of2, of3"),
        ({"aggregate": "max"}, "aggregate = 'max' must be one of mean, min, cvar"),
        ({"overlap": ()}, "overlap needs at least one weight"),
        ({"cvar_fraction": 0}, "cvar_fraction = 0 must lie in (0, 1]"),
        ({"cvar_fraction": 1.5}, "cvar_fraction = 1.5 must lie in (0, 1]"),
    ],
)
def test_settings_that_mean_nothing_are_refused(settings, message):
    with pytest.raises(ValueError) as error:
        paper(**settings)
    assert str(error.value) == message


@pytest.mark.parametrize("kind", ["of1", "of2", "of3"])
@pytest.mark.parametrize("by_area", [False, True])
@pytest.mark.parametrize("normalize", [False, True])
def test_values_of_many_layouts_are_those_of_each(kind, by_area, normalize, rng):
    objective = paper(kind=kind, by_area=by_area, normalize=normalize)
    counts, area = rng.integers(0, 9, (20, 30)), rng.random(30)
    counts[0] = 0
    each = [objective.terms(row, area)["value"] for row in counts]
    assert np.allclose(objective.values(counts, area), each, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("kind", ["of1", "of2", "of3"])
def test_value_by_model_is_the_value_of_each_model(kind):
    objective = paper(kind=kind)
    counts, areas = [COUNTS, [1, 0, 2]], [AREA, np.array([1.0, 2.0, 3.0])]
    each = [objective.terms(*pair)["value"] for pair in zip(counts, areas, strict=True)]
    assert objective.value_by_model(counts, areas).tolist() == each
