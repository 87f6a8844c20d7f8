"""How many cases of which kind a trial has, in an order that tells nothing."""

from dataclasses import dataclass

import numpy as np

NULL, SINGLE, PAIR, STRANGE, CONFOUNDED = 'null', 'single', 'pair', 'strange', 'confounded'
# Shares of a trial; the full one has 120 nulls, 10 singles a term, 40 pairs, and so on.
SHARES = {NULL: 120, SINGLE: 310, PAIR: 40, STRANGE: 40, CONFOUNDED: 30}
A_BODY = 12     # cases that share a body


@dataclass(frozen=True)
class Job:
    """One case to be made.

    name : case_000 and up, at random;  kind : of SHARES;  wish : name of a term or family, '' =
        any;  body : number of the body;  seed : of the trial;  number : of the draw within it
    attempt, body_attempt : how often case and body were drawn anew, since the generator could not
        make what was drawn
    """

    name: str
    kind: str
    wish: str
    body: int
    seed: int
    number: int
    attempt: int = 0
    body_attempt: int = 0

    def rng(self):
        """The random generator of this case."""
        return np.random.default_rng([self.seed, 1, self.number, self.attempt])

    def body_rng(self):
        """The random generator of its body, the same for all cases on it."""
        return np.random.default_rng([self.seed, 2, self.body, self.body_attempt])


def counts(cases):
    """Kind -> how many of `cases`, by SHARES, largest remainders first; sum is `cases`."""
    total = sum(SHARES.values())
    exact = {kind: cases * share / total for kind, share in SHARES.items()}
    found = {kind: int(value) for kind, value in exact.items()}
    for kind in sorted(exact, key=lambda k: found[k] - exact[k])[:cases - sum(found.values())]:
        found[kind] += 1
    return found


def draw(seed, cases, wishes):
    """The jobs of a trial, order of their names.

    seed : int, from `seal.seed_of`;  wishes : kind -> names that are gone through in turn, in an
    order drawn from the seed; a kind without any may be whatever the generator draws
    """
    rng = np.random.default_rng([seed, 0])
    kinds = [kind for kind, count in counts(cases).items() for _ in range(count)]
    wished = []
    for kind, count in counts(cases).items():
        names = rng.permutation(wishes.get(kind) or ['']).tolist()
        wished += [names[i % len(names)] for i in range(count)]
    bodies = np.arange(cases) % -(-cases // A_BODY)
    order, places = rng.permutation(cases), rng.permutation(bodies)
    return tuple(Job(f'case_{i:03d}', kinds[j], wished[j], int(places[i]), seed, i)
                 for i, j in enumerate(order.tolist()))
