"""Whole results: a run with its pictures, page and exports, series of runs, comparisons."""
