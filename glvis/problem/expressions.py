"""Linear expressions of named variables: "-alpha1", "180 - 2*beta", "(z1 + z2)/2".

Text becomes coefficients and a constant, so that a whole rig is one matrix. The text is
parsed, never run.
"""

from __future__ import annotations

import ast
import difflib
import graphlib
import keyword
import math
import unicodedata
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

_LONGEST = 1000  # characters; far beyond any expression meant, and safe for the parser


@dataclass(frozen=True)
class Linear:
    """A linear function of named variables.

    Attributes
    ----------
    constant : float
        Value where every variable is 0.
    coefficients : dict of str to float
        Factor of each variable, in the order they are named in.
    text : str
        What the user wrote, for messages.
    """

    constant: float
    coefficients: Mapping[str, float] = field(default_factory=dict)
    text: str = field(default="", compare=False)

    def __add__(self, other: Linear) -> Linear:
        total = dict(self.coefficients)
        for name, factor in other.coefficients.items():
            total[name] = total.get(name, 0.0) + factor
        return Linear(self.constant + other.constant, total)

    def scaled(self, factor: float) -> Linear:
        """Return this function times a number."""
        terms = {name: factor * value for name, value in self.coefficients.items()}
        return Linear(factor * self.constant, terms)


def parse_linear(text: str) -> Linear:
    """Return the linear function that a text like "180 - 2*beta" says.

    Numbers, names, + - * / and brackets; a dotted name such as ``A1.roll_deg`` is the variable
    of that place. Names are not looked up here.

    Raises
    ------
    ValueError
        If the text is no expression or is not linear.
    """
    if len(text) > _LONGEST:
        raise ValueError(f"has {len(text)} characters, more than {_LONGEST}")
    try:
        # a null byte is a ValueError of its own before Python 3.11.4; no more allowed than "?"
        tree = ast.parse(text.strip().replace("\0", "?"), mode="eval").body
        linear = _linear(tree)
    except (SyntaxError, RecursionError, MemoryError):
        raise ValueError("is no expression of numbers, names, + - * / and brackets") from None
    except OverflowError:
        raise ValueError("has a number that is too large") from None
    if not all(map(math.isfinite, (linear.constant, *linear.coefficients.values()))):
        raise ValueError("has a number that is too large")
    return Linear(linear.constant, linear.coefficients, text)


def plain_name(name: str) -> str:
    """Return a variable's name as expressions see it; refuse what they could not name."""
    if not name.isidentifier() or keyword.iskeyword(name):
        raise ValueError(
            f"'{name}' cannot name a variable: use letters, digits and '_', "
            "no digit first and no word of Python"
        )
    return unicodedata.normalize("NFKC", name)  # as Python's parser does with names


def substituted(expression: Linear, definitions: Mapping[str, Linear]) -> Linear:
    """Return the expression with every name replaced by its definition.

    Raises
    ------
    ValueError
        If a name has no definition; the message names the nearest one.
    """
    total = Linear(expression.constant)
    for name, factor in expression.coefficients.items():
        if name not in definitions:
            raise ValueError(f"unknown variable '{name}'{nearest(name, definitions)}")
        total += definitions[name].scaled(factor)
    return total


def resolved(free: Iterable[str], named: Mapping[str, Linear]) -> dict[str, Linear]:
    """Return every name in terms of the free ones, which are themselves.

    Parameters
    ----------
    free : iterable of str
        Names that no expression defines.
    named : dict of str to Linear
        Names that stand for an expression; each may use any of the others.

    Raises
    ------
    ValueError
        If definitions go round in a circle, or use an unknown name.
    """
    done = {name: Linear(0.0, {name: 1.0}) for name in free}
    uses = {
        name: [used for used in linear.coefficients if used in named]
        for name, linear in named.items()
    }
    try:
        order = list(graphlib.TopologicalSorter(uses).static_order())
    except graphlib.CycleError as error:
        circle = error.args[1][::-1]  # from a name to what it uses
        text = named[circle[0]].text
        raise ValueError(f"{circle[0]} = '{text}' is cyclic: {' -> '.join(circle)}") from None
    for name in order:
        try:
            done[name] = substituted(named[name], done)
        except ValueError as error:
            raise ValueError(f"{name} = '{named[name].text}': {error}") from None
    return done


def nearest(name: str, known: Iterable[str]) -> str:
    """Return "; did you mean 'x'?" for the known name nearest to ``name``, or ""."""
    close = difflib.get_close_matches(name, list(known), n=1)
    return f"; did you mean '{close[0]}'?" if close else ""


def _linear(node: ast.expr) -> Linear:
    """Return the linear function of a parsed expression."""
    match node:
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            return Linear(float(value))
        case ast.Name(id=name):
            return Linear(0.0, {name: 1.0})
        case ast.Attribute():
            return Linear(0.0, {_dotted(node): 1.0})
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return _linear(operand).scaled(-1.0)
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            return _linear(operand)
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            return _linear(left) + _linear(right)
        case ast.BinOp(left=left, op=ast.Sub(), right=right):
            return _linear(left) + _linear(right).scaled(-1.0)
        case ast.BinOp(left=left, op=ast.Mult(), right=right):
            a, b = _linear(left), _linear(right)
            if a.coefficients and b.coefficients:
                raise ValueError("is not linear: a product of variables")
            return a.scaled(b.constant) if a.coefficients else b.scaled(a.constant)
        case ast.BinOp(left=left, op=ast.Div(), right=right):
            divisor = _linear(right)
            if divisor.coefficients:
                raise ValueError("is not linear: a variable in a divisor")
            if divisor.constant == 0:
                raise ValueError("divides by zero")
            return _linear(left).scaled(1 / divisor.constant)
    raise ValueError("may hold numbers, names, + - * / and brackets only")


def _dotted(node: ast.expr) -> str:
    """Return "A1.roll_deg" of a chain of attributes."""
    match node:
        case ast.Name(id=name):
            return name
        case ast.Attribute(value=value, attr=attribute):
            return f"{_dotted(value)}.{attribute}"
    raise ValueError("may hold numbers, names, + - * / and brackets only")
