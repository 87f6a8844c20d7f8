"""One program per solver that `arm-brachy bench` compares, each run in a process of its own.

    python -m arm_brachy.experiments.peers.felupe_peer PROBLEM.npz ANSWER.npz

A peer is a package that a user might choose instead of arm_brachy.tissue. Only its own file
imports it, so a peer that is not installed costs its rows and nothing else.
"""
