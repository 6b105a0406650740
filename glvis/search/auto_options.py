"""The tuning constants of the search ``auto``; see ``glvis/docs/tuning.md`` for their story."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class AutoOptions:
    """Tuning constants of ``auto`` and of the parts it is made of; no study sets them.

    A share is one of the maps that may be rendered, unless it says of what.

    Attributes
    ----------
    starts : int
        Layouts that halving begins with, where no groups share variables: three rounds.
    greedy_share, surrogate_share, halving_share, restart_share : float
        Shares at whose end a stage ends: greedy starts; layouts optimised on the surrogate; rounds
        of halving; restarts of the last run. Local search has the rest, as it never ends.
    local_share : float
        Share of a round for local search; restarts, which find other hills, have the rest.
    surrogate_share_coupled, halving_share_coupled : float
        The same where groups share variables, with neither greedy choices nor restarts: a pose is
        good there only beside the others.
    passes : int
        Times through all blocks that a layout is improved before others are held against it:
        one that was never improved would always lose.
    halvings : int
        Rounds of halving at most, where groups share variables.
    layouts, renders : int
        Layouts optimised on the surrogate at a time, and times that each is rendered, which
        corrects the surrogate where it was wrong.
    rounds, rounds_coupled : int
        Rounds through all blocks before each of these times.
    restarts : int
        Restarts of a block that are rendered at first; the most that a second hill may need.
    restart_poses, restart_rounds : int
        Poses predicted for each of these, and rounds on the surrogate from the best of them.
    survivors, survivor_steps : int
        Restarts that halving begins with, a power of 2, and steps of local search in a round.
    tries, tries_predicted : int
        Candidates of a step of local search that are rendered, and predicted for each of these.
    step_sizes : tuple of float
        Powers of two between which a step lies, in shares of a variable's range: of all sizes, as
        no one size fits all of a search.
    shifts, shift_rounds : int
        Steps of what groups share, and rounds in which each group then adapts on the surrogate.
    candidates, candidates_coupled, candidates_least : int
        Candidates of a step on the surrogate; where groups share variables; at least, where a
        block moves many sensors and a prediction takes long.
    reach : float
        Width that poses are drawn from, in ranges of the variables; what lies outside is put on
        the bounds, where the best layouts often have some variable.
    draw_predicted : int
        Random poses of which greedy choice renders the best predicted.
    draws_least : int
        Poses that greedy choice renders of a group at least.
    greedy_starts : int
        Layouts of the method ``greedy``.
    first_share : float
        Share of the first choices, best first, that other greedy starts begin with.
    exchange_rounds : int
        Rounds of exchange at most.
    exchange_share : float
        Share of the poses, best first, that rounds after the first still try.
    faces, faces_least : int
        Faces that the surrogate samples, of all models together and of each at least: their ranks
        of poses agree with those by maps to 0.96.
    poses, pose_bytes : int
        Poses that the surrogate remembers at most, and bytes of them in a checkpoint.
    viewpoints : int
        Nearest viewpoints that vote on what is hidden; more of them agree with maps no better.
    flat_share : float
        Share of the farthest one's distance within which all weigh alike: no viewpoint decides
        alone.
    vote_seen, vote_hidden : int
        Weight of a vote: a third of them is enough for seen. Whole, as the sums are exact then.
    """

    starts: int = 8
    greedy_share: float = 0.1
    surrogate_share: float = 0.16
    halving_share: float = 0.6
    restart_share: float = 0.88
    local_share: float = 0.3
    surrogate_share_coupled: float = 0.1
    halving_share_coupled: float = 0.85
    passes: int = 5
    halvings: int = 5
    layouts: int = 32
    renders: int = 8
    rounds: int = 8
    rounds_coupled: int = 4
    restarts: int = 64
    restart_poses: int = 8
    restart_rounds: int = 4
    survivors: int = 8
    survivor_steps: int = 1
    tries: int = 4
    tries_predicted: int = 16
    step_sizes: tuple[float, float] = (-8.3, -1.7)
    shifts: int = 8
    shift_rounds: int = 1
    candidates: int = 32
    candidates_coupled: int = 16
    candidates_least: int = 4
    reach: float = 1.5
    draw_predicted: int = 8
    draws_least: int = 8
    greedy_starts: int = 4
    first_share: float = 0.3
    exchange_rounds: int = 8
    exchange_share: float = 0.1
    faces: int = 600
    faces_least: int = 100
    poses: int = 1 << 14
    pose_bytes: int = 1 << 20
    viewpoints: int = 16
    flat_share: float = 0.1
    vote_seen: int = 2
    vote_hidden: int = -1
