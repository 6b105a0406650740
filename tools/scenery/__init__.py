"""Makes the meshes in ``scenes/`` from formulas; ``tools/make_scenes.py`` is its command.

Only additions, multiplications, divisions, square roots and comparisons touch the numbers, each
rounded in one way by IEEE 754, and every choice has an order: the same files on every machine.
"""
