"""Search methods for comparison only: scripts of ``glvis.search.script``; see compare_methods."""

from methods.covariance import cma
from methods.differential import differential_evolution
from methods.refine import refine_alone

METHODS = {"refine": refine_alone, "cma": cma, "de": differential_evolution}
