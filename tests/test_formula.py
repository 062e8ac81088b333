"""Filters written as formulas."""

from __future__ import annotations

import random
import sys
import time

import numpy as np
import pytest
import shapes
from faults import raises

import meshmash_viewer as mv
from meshmash_viewer.errors import InputError
from meshmash_viewer.features.filters import (
    band_pass_bank,
    gaussian_pyramid_bank,
    heat_kernel_bank,
    low_pass_bank,
)
from meshmash_viewer.features.formula import Formula, FormulaError, formula_bank
from meshmash_viewer.features.truncation import mean_shares

EIGENVALUES = np.concatenate([[0.0, 0.0], np.geomspace(1e-9, 1e-7, 50)])


@pytest.mark.parametrize(
    ("text", "values", "wanted"),
    [
        ("1", {}, np.ones(52)),
        ("2*x - x + -x + +x", {}, EIGENVALUES),
        ("x**2 / (x**2 + c**2)", {"c": 1e-8}, EIGENVALUES**2 / (EIGENVALUES**2 + 1e-16)),
        ("exp(-t*x) * (x > 1e-8)", {"t": 1e8}, np.exp(-1e8 * EIGENVALUES) * (EIGENVALUES > 1e-8)),
        ("1e-9 < λ < 1e-8 or not λ", {}, (EIGENVALUES < 1e-8) & (EIGENVALUES != 1e-9)),
        ("(x >= 1e-9) & (x <= 1e-8)", {}, (EIGENVALUES >= 1e-9) & (EIGENVALUES <= 1e-8)),
        ("where(x > 0, 1/x, 0)", {}, np.append([0.0, 0.0], 1.0 / EIGENVALUES[2:])),
        ("minimum(x, 1e-8) + maximum(sin(pi/2), e)", {}, np.minimum(EIGENVALUES, 1e-8) + np.e),
        ("sqrt(abs(cos(0) - 2)) + tanh(0) + log(1)", {}, np.ones(52)),
        ("x - 1e-8", {}, EIGENVALUES - 1e-8),
        ("cos(t*sqrt(x))", {"t": 3e4}, np.cos(3e4 * np.sqrt(EIGENVALUES))),
        ("sin(t*x)/(t*x)", {"t": 3e8}, np.sinc(3e8 * EIGENVALUES / np.pi)),
        ("sin(t*x)/x", {"t": 3e8}, 3e8 * np.sinc(3e8 * EIGENVALUES / np.pi)),
    ],
)  # fmt: skip
def test_a_formula_is_what_it_says(text: str, values: dict[str, float], wanted: np.ndarray) -> None:
    found, atol = Formula(text)(EIGENVALUES, **values), 1e-13 * np.abs(wanted).max()
    np.testing.assert_allclose(found, wanted, rtol=1e-15, atol=atol)


@pytest.mark.parametrize(
    ("formula", "ready"),
    [
        (formula_bank("x < c", c=1e-8), low_pass_bank(1e-8)),
        (formula_bank("a <= x <= b", a=2e-9, b=1e-8), band_pass_bank(2e-9, 1e-8)),
        (formula_bank("exp(-s*x)", s=[1e7, 1e8, 1e9]), gaussian_pyramid_bank([1e7, 1e8, 1e9])),
        (formula_bank("exp(-t*x)", t=[1e7, 1e8]), heat_kernel_bank([1e7, 1e8])),
    ],
)
def test_ready_banks_are_formulas(formula, ready) -> None:
    np.testing.assert_array_equal(formula(EIGENVALUES), ready(EIGENVALUES))
    np.testing.assert_array_equal(len(formula.columns), len(ready.columns))


@pytest.mark.parametrize(
    ("text", "powers"),
    [
        ("x < c", {"c": -2}),
        ("a <= x <= b", {"a": -2, "b": -2}),
        ("exp(-t*x) * (x > 1e-8)", {"t": 2}),
        ("exp(-log(x/c)**2 / (2*w**2))", {"c": -2, "w": 0}),
        ("exp(-x*length**2)", {"length": 1}),
        ("1 / (1 + (x/c)**n)", {"c": -2, "n": 0}),
        ("g * (x < c)", {"g": 0, "c": -2}),
        ("exp(-x**2 / a)", {"a": -4}),
        ("x", {}),
    ],
)
def test_the_unit_of_a_parameter_follows_from_the_formula(text: str, powers: dict) -> None:
    assert Formula(text).powers == powers


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "There is no formula"),
        ("exp(-t*x", "at character 4: this bracket is not closed, so add )"),
        ("exp(-t*x))", "at character 10: this bracket closes none"),
        ("2x", "at character 2: write a sign such as * between 2 and x"),
        ("1e-3*x+exp(-t x)", "at character 15: write a sign such as * between t and x"),
        ("exp(-t*lambda)", "at character 8: lambda is a reserved word, so write x for λ"),
        ("x +* 2", "at character 4: write one such as exp(-2*t*x)"),
        ("x^", "cannot be read at character 2"),
        (" t + x*", "cannot be read at character 7"),
        ("__import__('os').system('true')", "wrong at character 1"),
        ("x.real", "wrong at character 1"),
        ("2 * x[0]", "wrong at character 5"),
        ("f(x)", "f is not a function; functions are exp"),
        ("exp", "exp is a function"),
        ("where(x)", "where takes 3 values"),
        ("x == 1", "only numbers"),
        ("lambda: 1", "only numbers"),
        ("True", "only numbers"),
        ("1e400", "too large"),
        ("x" * 201, "longer than 200"),
        ("-" * 40 + "x", "nested deeper"),
    ],
)
def test_what_is_no_formula_is_one_sentence(text: str, word: str) -> None:
    with raises("unreadable-formula", word):
        Formula(text)
    with raises("too-many", "5 parameters"):
        Formula("a+b+c+d+x+g")


@pytest.mark.parametrize(
    ("text", "python"),
    [
        ("x^2", "x**2"), ("2^-x", "2**-x"), ("-x^2 + 9", "-(x**2) + 9"), ("(x ^ 2) ^ 0.5", "x"),
        ("exp(−t·x²)", "exp(-t*x**2)"), ("(x ≤ 0.5) × (x ≥ 0.5)", "(x <= 0.5) * (x >= 0.5)"),
        ("ln(1 + x)", "log(1 + x)"), (" exp(-t*λ^1.5)", "exp(-t*x**1.5)"),
    ],
)  # fmt: skip
def test_signs_may_be_written_as_papers_have_them(text: str, python: str) -> None:
    values = dict.fromkeys(Formula(python).parameters, 0.3)
    spectrum = np.array([0.0, 0.5, 2.0])
    np.testing.assert_allclose(
        Formula(text)(spectrum, **values), Formula(python)(spectrum, **values)
    )


@pytest.mark.parametrize(
    ("before", "fault"),
    [
        ("", "f(x)"), ("x^2 + ", "f(x)"), ("λ^2 + λ**2 + ", "x[0]"), ("  λ*", "[1]"),
        ("x^2^3 + exp(", "sin)"), ("x^", ")"), ("λ + ", "$"), ("x ^ ", "*2"),
    ],
)  # fmt: skip
def test_an_error_points_at_the_character(before: str, fault: str) -> None:
    with pytest.raises(FormulaError) as caught:
        Formula(before + fault)
    assert caught.value.position == len(before)
    assert f"character {len(before) + 1}" in str(caught.value)


@pytest.mark.parametrize(
    ("text", "values", "code", "word"),
    [
        ("1/x", {}, "not-finite", "infinite at λ = 0: write where"),
        ("log(x - 1e-8)", {}, "not-finite", "not a number at λ = 1e-09"),
        ("log(x/c)", {"c": 1e-8}, "not-finite", "infinite at λ = 0: write where"),
        ("sin(1/x)", {}, "not-finite", "not a number at λ = 0: write where"),
        ("9**9**9", {}, "not-finite", "infinite"),
        ("exp(t*x)", {"t": 1e30}, "not-finite", "its parameters"),
        ("exp(-t*x)", {}, "missing-argument", "has a parameter t"),
        ("x", {"t": 1.0}, "unknown-name", "has no parameter t"),
    ],
)
def test_what_is_no_filter_here_is_one_sentence(
    text: str, values: dict, code: str, word: str
) -> None:
    with raises(code, word):
        Formula(text)(EIGENVALUES, **values)


@pytest.mark.parametrize(
    ("text", "limit", "accuracy"),
    [
        ("sin(x)/x", 1.0, 1e-12), ("(1 - cos(t*x)) / (t*x)^2", 0.5, 1e-5),
        ("(exp(-t*x) - 1) / x", -1e8, 1.0), ("tanh(sqrt(t*x)) / sqrt(t*x)", 1.0, 1e-6),
        ("t*x*log(t*x)", 0.0, 1e-6), ("x/sqrt(x)", 0.0, 1e-9), ("0*log(x)", 0.0, 0.0),
    ],
)  # fmt: skip
def test_a_formula_without_a_value_at_zero_has_its_limit(text, limit, accuracy) -> None:
    formula = Formula(text)
    values = dict.fromkeys(formula.parameters, 1e8)
    assert formula(EIGENVALUES, **values)[:2] == pytest.approx(limit, abs=accuracy)


def test_waves_of_a_map_are_negative_and_their_error_is_bounded() -> None:
    """An eigenfunction φ swings as cos(t√λ) φ; sums of signed filters are direct sums."""
    rectangle = shapes.rectangle(20, 15)
    pairs = mv.solve(*mv.cotangent_laplacian(rectangle), 40)
    time = np.pi / np.sqrt(pairs.eigenvalues[5])
    wave = formula_bank("cos(t*sqrt(x))", t=time)
    first = np.asarray(pairs.eigenvectors[:, 5])
    assert_close = np.testing.assert_allclose
    assert_close(mv.filter_map(pairs, first, wave), -first, atol=1e-9 * np.abs(first).max())
    found = mv.compute_features(pairs, wave, warn=False)
    direct = np.square(pairs.eigenvectors) @ np.cos(time * np.sqrt(pairs.eigenvalues))
    assert found.values.min() < 0.0
    assert_close(found.values[:, 0], direct, atol=1e-9 * np.abs(direct).max())
    # a part that is subtracted is missing, too
    every = mv.solve(*mv.cotangent_laplacian(rectangle), rectangle.n_vertices)
    whole = np.square(every.eigenvectors) @ np.cos(time * np.sqrt(every.eigenvalues))
    bound = found.truncation.remainder.bound(found.values)[:, 0]
    assert (np.abs(whole - direct) <= bound * (1.0 + 1e-9)).all()
    (share,) = mean_shares(wave, pairs.eigenvalues, rectangle.area, rectangle.n_vertices)
    assert 0.5 < share <= 1.0


def test_an_eigenvalue_that_is_zero_but_for_rounding_is_zero() -> None:
    for rounding in (1e-20, -1e-20):
        values = np.append(rounding, EIGENVALUES[2:])
        assert Formula("where(x > 0, 1/x, 5)")(values)[0] == 5.0
        assert Formula("sqrt(x)")(values)[0] == 0.0


def test_one_parameter_alone_goes_through_columns() -> None:
    with raises("conflicting-arguments"):
        formula_bank("a <= x <= b", a=[1.0, 2.0], b=[3.0, 4.0])
    bank = formula_bank("a <= x <= b", a=1e-9, b=[2e-9, 1e-8])
    assert (bank.parameter_name, bank.parameter_power) == ("b", -2)
    assert bank(EIGENVALUES).sum(axis=1).tolist() == [
        np.count_nonzero(EIGENVALUES[2:] <= b) for b in (2e-9, 1e-8)
    ]


PIECES = (
    *("x", "t", "exp", "log", "where(", "(", ")", "+", "-", "*", "**", "/", "//", "%", "@", "<"),
    *("==", "and", "not", "if", "else", "lambda", ":=", ",", ".", "\\", "[", "]", "{", "'", "#"),
    *("\n", "\0", "λ", "²", "０", "__class__", "__import__('os')", "().__class__", "x.real", "f''"),
    *("await", "1e308", "1e400", "9" * 400, "9**9**9", "1j", "0x1", "True", "None", "...", "*x"),
    *("(" * 120, "-" * 150, "x" * 300, "**2" * 60),
)
#: Audit events that a formula must not cause; "compile" is allowed, as parsing causes it.
FORBIDDEN = ("open", "import", "exec", "os.", "subprocess.", "socket.", "ctypes.", "object.")


@pytest.mark.slow
def test_broken_formulas_are_values_or_one_sentence() -> None:
    whole, seen, counts = (
        ["exp(-t*x) * (x > 1e-8)", "not (x > c) or sqrt(abs(sin(pi*x)))"],
        [],
        [0, 0],
    )
    listening = True
    sys.addaudithook(lambda event, _: seen.append(event) if listening else None)
    for seed in range(2000):
        rng = random.Random(seed)
        text = rng.choice(whole)
        for _ in range(rng.choice((0, 1, 1, 2, 3, 8))):
            at, end = sorted(rng.randrange(len(text) + 1) for _ in range(2))
            text = text[:at] + rng.choice(PIECES) + text[end if rng.random() < 0.4 else at :]
        began = time.thread_time()
        try:
            formula = Formula(text)
            found = formula(EIGENVALUES, **dict.fromkeys(formula.parameters, 1e7))
            assert np.isfinite(found).all()
            counts[0] += 1
        except InputError as refused:
            said = str(refused)
            assert said.endswith(".")
            assert "\n" not in said
            assert len(said) < 400
            counts[1] += 1
        assert time.thread_time() - began < 1.0
        if not seed:
            seen.clear()  # imports of all that the parser needs
    listening = False  # Python cannot remove a hook.
    assert not [event for event in seen if event.startswith(FORBIDDEN)]
    assert min(counts) > 200
