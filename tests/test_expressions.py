"""Linear expressions: what they say, and what is refused in one line."""

import math

import pytest

from glvis.problem.expressions import (
    Linear,
    nearest,
    parse_linear,
    plain_name,
    resolved,
    substituted,
)


@pytest.mark.parametrize(
    ("text", "constant", "coefficients"),
    [
        ("-alpha1", 0, {"alpha1": -1}),
        ("180 - 2*beta", 180, {"beta": -2}),
        ("z1 + 300", 300, {"z1": 1}),
        ("(a + b)/2", 0, {"a": 0.5, "b": 0.5}),
        ("2*(a - 3)*4 - -b", -24, {"a": 8, "b": 1}),
        (" 7 ", 7, {}),
        ("+1e3 * a", 0, {"a": 1000}),
        ("a*(2 - 1/2)", 0, {"a": 1.5}),
        ("90 - A1.roll_deg", 90, {"A1.roll_deg": -1}),
        ("α - β/4", 0, {"α": 1, "β": -0.25}),
        ("a + b - a", 0, {"a": 0, "b": 1}),
    ],
)
def test_text_becomes_coefficients(text, constant, coefficients):
    linear = parse_linear(text)
    assert linear.constant == constant
    assert linear.coefficients == coefficients
    assert linear.text == text


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a*b", "is not linear: a product of variables"),
        ("a*a", "is not linear: a product of variables"),
        ("1/a", "is not linear: a variable in a divisor"),
        ("a/(3 - 3)", "divides by zero"),
        ("a**2", "may hold numbers, names, + - * / and brackets only"),
        ("sin(a)", "may hold numbers, names, + - * / and brackets only"),
        ("__import__('os').x", "may hold numbers, names, + - * / and brackets only"),
        ("'text'", "may hold numbers, names, + - * / and brackets only"),
        ("True", "may hold numbers, names, + - * / and brackets only"),
        ("2j", "may hold numbers, names, + - * / and brackets only"),
        ("a[0]", "may hold numbers, names, + - * / and brackets only"),
        ("", "is no expression of numbers, names, + - * / and brackets"),
        ("2 +", "is no expression of numbers, names, + - * / and brackets"),
        ("2 a", "is no expression of numbers, names, + - * / and brackets"),
        ("a = 3", "is no expression of numbers, names, + - * / and brackets"),
        ("a\0b", "is no expression of numbers, names, + - * / and brackets"),
        ("(" * 900, "is no expression of numbers, names, + - * / and brackets"),
        ("-" * 990 + "a", "is no expression of numbers, names, + - * / and brackets"),
        ("1" * 1001, "has 1001 characters, more than 1000"),
        ("1e999", "has a number that is too large"),
        ("1" + "0" * 400, "has a number that is too large"),
        ("1e308*10*a", "has a number that is too large"),
    ],
)
def test_what_is_not_linear_is_refused(text, message):
    with pytest.raises(ValueError) as caught:
        parse_linear(text)
    assert str(caught.value) == message


def test_definitions_are_resolved_in_any_order():
    named = {"late": "2*early + b", "early": "a - 5", "fixed": "3"}
    found = resolved(["a", "b"], {n: parse_linear(t) for n, t in named.items()})
    assert found["late"] == Linear(-10, {"a": 2, "b": 1})
    assert found["fixed"] == Linear(3)
    assert substituted(parse_linear("late/2 + fixed"), found) == Linear(-2, {"a": 1, "b": 0.5})


@pytest.mark.parametrize(
    ("named", "message"),
    [
        ({"a": "b", "b": "a + 1"}, "a = 'b' is cyclic: a -> b -> a"),
        ({"a": "2*a"}, "a = '2*a' is cyclic: a -> a"),
        ({"a": "a"}, "a = 'a' is cyclic: a -> a"),
        ({"x": "a", "a": "b", "b": "c", "c": "a"}, "a = 'b' is cyclic: a -> b -> c -> a"),
        ({"b": "alphe"}, "b = 'alphe': unknown variable 'alphe'; did you mean 'alpha'?"),
        ({"b": "q"}, "b = 'q': unknown variable 'q'"),
    ],
)
def test_definitions_that_lead_nowhere_are_refused(named, message):
    with pytest.raises(ValueError) as caught:
        resolved(["alpha"], {name: parse_linear(text) for name, text in named.items()})
    assert str(caught.value) == message


def test_long_chains_of_definitions_are_resolved():
    chain = {f"v{i}": parse_linear(f"v{i + 1} + 1") for i in range(3000)}
    assert resolved(["v3000"], chain)["v0"] == Linear(3000, {"v3000": 1})


@pytest.mark.parametrize("name", ["", "2a", "a-b", "a.b", "lambda", "a b", "None"])
def test_names_that_no_expression_could_use_are_refused(name):
    with pytest.raises(ValueError, match=f"'{name}' cannot name a variable: use letters"):
        plain_name(name)


def test_the_micro_sign_and_the_letter_mu_are_one_name():
    assert plain_name("\N{MICRO SIGN}") == plain_name("\N{GREEK SMALL LETTER MU}")
    (name,) = parse_linear("2*\N{MICRO SIGN}").coefficients
    assert name == plain_name("\N{MICRO SIGN}")


def test_linear_functions_add_and_scale():
    total = Linear(1, {"a": 2}) + Linear(3, {"a": 1, "b": 5}).scaled(-2)
    assert total == Linear(-5, {"a": 0, "b": -10})
    assert math.isfinite(total.constant)


def test_nearest_says_nothing_where_nothing_is_near():
    assert nearest("max_dist", ["min_distance", "max_distance"]) == "; did you mean 'max_distance'?"
    assert nearest("q", ["min_distance"]) == ""
