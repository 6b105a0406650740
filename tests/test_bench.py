"""The benchmark itself: it must compare like with like before its times mean anything."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

BENCH = Path(__file__).resolve().parents[1] / "tools" / "bench.py"


def run(*arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, str(BENCH), *arguments], capture_output=True, text=True, check=True
    )
    return done.stdout


def test_both_sides_of_the_benchmark_make_the_same_maps():
    pytest.importorskip("embreex", reason="the rival is missing: pip install '.[bench]'")
    row = json.loads(run("--one-size", "20000", "--repeats", "1").splitlines()[-1])
    assert abs(row["faces"] - 20000) < 500
    assert row["centroid_iou"] > 0.995 and row["pixels_iou"] > 0.99
    assert 0 < row["read_and_map_peak_mib"] < 1500


def test_an_unknown_part_of_the_benchmark_is_refused():
    pytest.importorskip("embreex", reason="the rival is missing: pip install '.[bench]'")
    done = subprocess.run(
        [sys.executable, str(BENCH), "--only", "speed"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1 and "unknown part speed; choose from arms, kitchen" in done.stderr
