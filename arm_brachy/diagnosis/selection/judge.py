"""From responses to a verdict: one cause, a class of causes, two causes, nothing, or no idea.

All is judged on one whitened residual r and on what may be in it besides: nuisances and errors of
the mesh, U (`linear_gaussian`). Causes come as explanations: columns by which their parameters,
each at one prior standard deviation, move r; a cause with a free place has one explanation for
each place.

The order of the steps is what keeps claims honest. Nothing is claimed unless something is left by
structured tests or a cause gains evidence beyond chance; nothing is named unless it also predicts
kinds of experiment that it was not fitted to, and leaves nothing; what these data cannot tell from
it is named with it. Responses rank all causes; the few that promise most are weighed by full fits:
where an answer bends with its size, or a place lies between those tried, a response misleads.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.special import log_ndtr, logsumexp

from arm_brachy.diagnosis.settings import Rules
from arm_brachy.diagnosis.statistics.linear_gaussian import evidence_over_none, separation
from arm_brachy.diagnosis.statistics.misfit_scan import scan

VERDICTS = Literal['named', 'equivalent', 'nothing_missing', 'unexplained']




@dataclass(frozen=True)
class Explanation:
    """One way in which a cause may show.

    cause : term of the registry;  variant : which actuator, marker or place ('' = it has none)
    columns : (n, p) change of r per prior standard deviation of each parameter
    log_prior : of the cause before the data, natural logarithm
    load_cases : different pushes that it takes to tell it from a load
    one_sided : per parameter True if it cannot be negative; () = all can
    channel : actuators, sensors, markers or streams that carry it, empty = none of them, or all
    """

    cause: str
    variant: str
    columns: np.ndarray
    log_prior: float = 0.0
    load_cases: int = 1
    one_sided: tuple = ()
    channel: frozenset = frozenset()

    @property
    def limited(self):
        """(p,) True for parameters that cannot be negative."""
        return np.array(self.one_sided or (False,) * self.columns.shape[1], dtype=bool)


@dataclass(frozen=True)
class Problem:
    """What is to be explained.

    r : (n,) residual over noise;  U : (n, k) nuisances and mesh, in prior standard deviations
    kinds : (n,) kind of experiment of every row, whole kinds are held out
    tests : (n, m) columns of structured tests (`misfit_tests`)
    explanations : tuple of Explanation
    pushes : (n,) number of the load case of every row, -1 = none (`problem.load_cases`)
    together : indices of tests that are one effect in several directions (`misfit_scan.scan`)
    """

    r: np.ndarray
    U: np.ndarray
    kinds: np.ndarray
    tests: np.ndarray
    explanations: tuple
    pushes: np.ndarray
    together: tuple = ()


@dataclass(frozen=True)
class Candidate:
    """What a cause is worth.

    explanations : the best one, or both of a pair;  evidence, held_out : gains over no cause
    mean, sd : (p,) of its parameters, in prior standard deviations
    paid : per explanation, what its choice among the variants of its cause costs in evidence
    separation : from the cause that was accepted [sd]; inf for itself
    fit : log density of the data and its numbers at their best, over no cause: evidence but for
        the volumes, which favour causes of few numbers where the data cannot tell
    weighed : True if evidence and fit are those of a full fit
    """

    explanations: tuple
    evidence: float
    held_out: float
    mean: np.ndarray
    sd: np.ndarray
    paid: tuple = (0.0,)
    separation: float = np.inf
    fit: float = 0.0
    weighed: bool = False

    @property
    def causes(self):
        """Names of its causes."""
        return tuple(e.cause for e in self.explanations)


@dataclass(frozen=True)
class Decision:
    """The verdict and what speaks for it.

    accepted : Candidate that is named or heads the class; None if none is
    equals : Candidates that these data cannot tell from it, the same cause in other channels first
    ranked : all single causes, best first
    left : misfit_scan.Scan with the accepted cause, or without any;  before : Scan without any
    unproven : Candidate that explains all, as a load does that is none of the causes
    nearest : Candidate that stands out where nothing explains all; None if none does
    """

    verdict: VERDICTS
    accepted: Candidate | None
    equals: tuple
    ranked: tuple
    left: object
    before: object
    unproven: Candidate | None = None
    nearest: Candidate | None = None

    @property
    def shape(self):
        """Candidate that says where and when, although it is not claimed; None = the tests do.

        What is as it has it may be a load; or no test sees what it would explain.
        """
        seen = self.before.chance < Rules().alarm
        return self.unproven or (None if seen else self.nearest)

    def shared(self, candidate):
        """Per explanation of a Candidate of the class: True if all of them have it."""
        others = (self.accepted, *self.equals)
        return tuple(bool(self.equals) and all(any(e is x for x in one.explanations)
                                               for one in others)
                     for e in candidate.explanations)


class _Gram:
    """Inner products in C^-1 = (I + U U')^-1 of all explanations' columns and of r.

    total : (k + P + 1)^2 products of U, of the columns and of r over some of the rows
    limited : (P,) True for columns whose coefficients cannot be negative
    """

    def __init__(self, total, k, limited):
        self._limited = limited
        factor = cholesky(np.eye(k) + total[:k, :k], lower=True)
        seen = solve_triangular(factor, total[:k, k:], lower=True)
        self.left = total[k:, k:] - seen.T @ seen

    def normal(self, columns):
        """(X' C^-1 X (p, p), X' C^-1 r (p,)) of columns by their numbers (p,)."""
        return self.left[np.ix_(columns, columns)], self.left[columns, -1]

    def gain(self, columns):
        """Log evidence of columns with normal coefficients over none, plus `sign`."""
        return evidence_over_none(*self.normal(columns)) + self.sign(columns)

    def sign(self, columns):
        """What the signs of columns' coefficients are worth in evidence: log 2 P(c >= 0) each.

        Of coefficients that cannot be negative; exact for one, several taken as independent.
        """
        limited = self._limited[columns]
        if not limited.any():
            return 0.0
        B, a = self.normal(columns)
        covariance = np.linalg.inv(np.eye(len(a)) + B)
        z = (covariance @ a) / np.sqrt(np.diag(covariance))
        return float(np.sum(np.log(2.0) + log_ndtr(z[limited])))


def _grams(problem):
    """(_Gram of all rows, [_Gram without each kind]).

    Products of one kind are 60 MB with the nuisances of a recording, so that they are made twice
    and held one at a time: kinds may be many.
    """
    every = np.hstack([problem.U, *(e.columns for e in problem.explanations),
                       problem.r[:, None]])
    kinds, k = np.unique(problem.kinds), problem.U.shape[1]
    limited = np.concatenate([e.limited for e in problem.explanations] or [np.zeros(0, bool)])

    def products(kind):
        rows = every[problem.kinds == kind]
        return rows.T @ rows

    total = sum(map(products, kinds))
    return _Gram(total, k, limited), [_Gram(total - products(kind), k, limited) for kind in kinds]


class Judge:
    """Decides on one Problem.

    rng : numpy.random.Generator for the distribution of structured tests
    check : Candidate -> misfit_scan.Scan of what it leaves, where the answer to a cause as large
        as that is no longer linear; None = by the columns of the problem
    gone : Candidate -> True if nothing is left of it where its answer is not linear; None = never
    weigh : Candidate -> laplace.Gain of its full fit over its response, None where it does not
        settle; None = nothing is weighed
    beyond : (Candidate that was weighed, Explanations) -> their log evidence in what it leaves,
        beside what its law may have wrong; None = a law has nothing wrong
    """

    def __init__(self, problem, rng, rules=None, check=None, gone=None, weigh=None, beyond=None):
        self.problem, self.rules, self._rng = problem, rules or Rules(), rng
        self._gone = gone or (lambda candidate: False)
        self._weigh = weigh or (lambda candidate: None)
        self._beyond = beyond or (lambda candidate, explanations: np.inf)
        self._left = check or (lambda candidate: self._scan(candidate.explanations))
        self._known, self._one = {}, None
        self._all, self._without = _grams(problem)
        self._variants = {}
        for one in problem.explanations:
            self._variants.setdefault(one.cause, []).append(one)
        ends = np.cumsum([0, *(e.columns.shape[1] for e in problem.explanations)])
        self._columns = {id(e): np.arange(a, b) for e, a, b in
                         zip(problem.explanations, ends[:-1], ends[1:], strict=True)}

    def decide(self):
        """Return the Decision."""
        before, ranked, tried, left, refuted = self._before(), *self._singly()
        if before.chance >= self.rules.alarm and tried is None:
            return Decision('nothing_missing', None, (), ranked, before, before)
        if tried is None or left.chance < self.rules.alarm:
            pair = self._pair_beyond(tried, ranked)
            if pair is not None:
                tried, left = pair, self._check(pair)
        else:
            tried, left = self._certain_pair(tried, ranked) or (tried, left)
        if tried is None or left.chance < self.rules.alarm:
            return Decision('unexplained', None, (), ranked, left, before, nearest=tried)
        equals = (*self._in_other_channels(tried), *self._equals(
            tried, [one for one in ranked if one.causes not in refuted]))
        if not equals and self._may_be_load(tried):
            return Decision('unexplained', None, (), ranked, left, before, tried)
        return Decision('equivalent' if equals else 'named', tried, equals, ranked, left, before)

    def outstanding(self):
        """(Explanations, misfit_scan.Scan of what they leave): of the single cause that is far
        ahead of all others by its response, weighed; () where none stands out; None where some do.
        """
        ranked = self.singles()
        if not any(map(self._claims, ranked)):
            return (), self._before()
        if ranked[0].evidence - max((one.evidence for one in ranked[1:2]),
                                    default=0.0) < self.rules.certain:
            return None
        first = self._weighed(ranked[0])
        return first.explanations, self._check(first)

    def alone(self):
        """(Explanations, misfit_scan.Scan of the rest) of the best single cause; () = none."""
        _, tried, left, _ = self._singly()
        return tried.explanations if tried else (), left

    def _singly(self):
        """(`weighed_singles`, *`_alone`), made once."""
        if self._one is None:
            ranked = self.weighed_singles()
            self._one = ranked, *self._alone(ranked, self._before())
        return self._one

    def _before(self):
        """adequacy.Scan without any cause, made once."""
        if () not in self._known:
            self._known[()] = self._scan(())
        return self._known[()]

    def _alone(self, ranked, before):
        """The single cause to go on with, None if none; what it leaves; causes told from it.

        The first that stands out and does not vanish where it is fitted in full; one that is
        nearly as likely where that leaves something and this does not, which tells the two apart.
        None stands in for a likelier one of which too little is known.
        """
        first, refuted, ahead = None, [], -np.inf
        for one in ranked[:self.rules.alone]:
            if ahead - one.evidence >= self.rules.rival or not self._claims(one):
                continue
            gone = self._gone(one)
            if one.weighed or not gone:
                ahead = max(ahead, one.evidence)
            if gone:
                continue
            for way in (one, *self._richer(one)):
                left = self._check(way)
                if left.chance >= self.rules.alarm:
                    return way, left, refuted
            first = first or (one, self._check(one))
            refuted.append(one.causes)
        return (*(first or self._accounting(ranked, before) or (None, before)), [])

    def _accounting(self, ranked, before):
        """The cause that leaves nothing of what the tests see, and what it leaves; None if none.

        Where it is far ahead of all others.
        """
        if before.chance >= self.rules.alarm or not ranked:
            return None
        one, second = ranked[0], max((c.evidence for c in ranked[1:2]), default=-np.inf)
        if one.evidence - second < self.rules.rival or not self._accounts(one) or self._gone(one):
            return None
        left = self._check(one)
        return (one, left) if left.chance >= self.rules.alarm else None

    def _check(self, one):
        """adequacy.Scan of what a Candidate leaves, made once."""
        key = tuple(map(id, one.explanations))
        if key not in self._known:
            self._known[key] = self._left(one)
        return self._known[key]

    def _claims(self, one, over=None):
        """True if a Candidate stands out, from no cause or from the one in `over`."""
        evidence = one.evidence - (over.evidence if over else 0.0)
        held_out = one.held_out - (over.held_out if over else 0.0)
        return self._certain(one, over) or (
            evidence >= self.rules.evidence and held_out >= self.rules.held_out)

    def _certain(self, one, over=None):
        """True if a Candidate stands out by so much that kinds held out need not show it."""
        evidence = one.evidence - (over.evidence if over else 0.0)
        held_out = one.held_out - (over.held_out if over else 0.0)
        lost = max(-held_out, 0.0)
        return (evidence - lost >= self.rules.certain
                and lost <= self.rules.gainsaid * evidence)

    def _accounts(self, one, over=None):
        """True if a Candidate may be what tests see that is missing, though not `_claims`.

        An offset within what calibration may take up predicts nothing better that was held out.
        """
        evidence = one.evidence - (over.evidence if over else 0.0)
        held_out = one.held_out - (over.held_out if over else 0.0)
        return evidence >= self.rules.evidence and held_out >= -self.rules.gainsaid * evidence

    def _may_be_load(self, candidate):
        """True if a cause of it shows in fewer pushes than tell it from a load."""
        first = 0
        for e in candidate.explanations:
            width = e.columns.shape[1]
            effect = e.columns @ candidate.mean[first:first + width]
            first += width
            if e.load_cases > 1 and self._pushes_showing(effect) < e.load_cases:
                return True
        return False

    def _pushes_showing(self, effect):
        """Number of load cases in which an effect (n,) is as large as what is told apart."""
        pushed = self.problem.pushes >= 0
        power = np.bincount(self.problem.pushes[pushed], effect[pushed]**2)
        return int(np.sum(power >= self.rules.apart**2))

    def singles(self):
        """The best Candidate of every cause, by evidence averaged over its variants."""
        return _sorted(self._best(cause) for cause in self._variants)

    def weighed_singles(self):
        """`singles`, those that promise most weighed, in their new order.

        Where the first is far ahead and leaves nothing, the others need not be, but for those
        whose responses do nearly as well; nor, whatever it leaves, those that do `hopeless`.
        """
        ranked, asked = self.singles(), set()
        response = {one.causes: one.evidence for one in ranked}
        for _ in range(self.rules.weighed):
            first = ranked[0]
            one = next((c for c in ranked if c.causes not in asked), first)
            # a part `bent` of an effect is twice that part of its evidence, which is quadratic
            far = (first.evidence - one.evidence >= self.rules.certain
                   and response[first.causes] - one.evidence >= max(
                       self.rules.rival, 2.0 * self.rules.bent * response[first.causes]))
            least = max(self.rules.promising, self.rules.hopeless * response[first.causes])
            if one.evidence < least or one.causes in asked or (
                    far and self._check(first).chance >= self.rules.alarm):
                break
            asked.add(one.causes)
            ranked = _sorted(self._weighed(c) if c is one else c for c in ranked)
        return ranked

    def _weighed(self, one):
        """A Candidate with the evidence of its full fit, as it is where that does not settle."""
        more = self._weigh(one)
        return one if more is None else replace(one, evidence=one.evidence + more.evidence,
                                                fit=one.fit + more.fit, weighed=True)

    def _pair_beyond(self, tried, ranked):
        """The pair that stands out from the single cause `tried` (None = none); None if none does.

        Where that cause leaves what the tests see.
        """
        pair, lead = self._best_pair(ranked)
        ahead = tried is not None and lead >= self.rules.rival

        def shows(pair, over):
            return self._claims(pair, over) or (ahead and self._accounts(pair, over))
        return self._pair_showing(pair, tried, shows, self.rules.evidence)

    def _certain_pair(self, tried, ranked):
        """(The pair that is certain beside `tried`, the Scan of what it leaves); None if none is.

        Where the tests see nothing that `tried` leaves: many weak ones are asked at once, and one
        cause may bend to much of what two did. A pair that leaves something is none, unless it
        does without `tried`: what two others explain so much better is not that one cause.
        """
        if not tried.weighed:
            return None
        pair = self._pair_showing(self._best_pair(ranked)[0], tried, self._certain,
                                  self.rules.certain)
        left = pair and self._check(pair)
        if left and (left.chance >= self.rules.alarm or not set(pair.causes) & set(tried.causes)):
            return pair, left
        return None

    def _pair_showing(self, pair, tried, shows, added):
        """A pair (None = none), weighed, if it `shows` over the single cause `tried`; else None.

        By responses, and by full fits as well where that of the single cause settled: what the
        pair's linear answer gains may be what that of the single one has wrong. And what comes in
        has to add so much evidence beside what the single cause's law may have wrong.
        """
        alone = tried and self._candidate(tried.explanations, tried.paid)
        if pair is None or not shows(pair, alone):
            return None
        settled = tried is not None and tried.weighed
        if settled and not self._adds(pair, tried) >= added:
            return None
        pair = self._weighed(pair)
        if settled and not (pair.weighed and shows(pair, tried)):
            return None
        return None if self._gone(pair) else pair

    def _adds(self, pair, tried):
        """Evidence of what a pair has more than `tried`, beside what its law may have wrong."""
        new = tuple(e for e in pair.explanations if e.cause not in tried.causes)
        return self._beyond(tried, new)

    def _best(self, cause, beside=()):
        """The best Candidate of a cause, alone or beside Candidates of others as they are."""
        variants = self._variants[cause]
        rest = tuple(e for one in beside for e in one.explanations)
        paid = tuple(p for one in beside for p in one.paid)
        gains = np.array([self._all.gain(self._of((*rest, v))) for v in variants])
        best = self._simplest(variants, gains - (self._all.gain(self._of(rest)) if rest else 0.0))
        chosen = logsumexp(gains) - np.log(len(gains)) - gains[best] + variants[0].log_prior
        return self._candidate((*rest, variants[best]), (*paid, float(chosen)))

    def _richer(self, one):
        """The variant that gains most of the cause of a Candidate, if more numbers: () or one."""
        variants = self._variants[one.causes[0]]
        gains = [self._all.gain(self._of((v,))) for v in variants]
        best, = one.explanations
        richest = variants[int(np.argmax(gains))]
        if richest.columns.shape[1] <= best.columns.shape[1]:
            return ()
        return (self._candidate((richest,), (one.paid[0] - max(gains)
                                             + self._all.gain(self._of((best,))),)),)

    def _simplest(self, variants, gains):
        """Number of the variant that gains most, but for numbers that it may owe to its response.

        gains : log evidence that each variant adds to what it stands beside
        By as much as a response has wrong of a large effect, a second number fits better than one:
        half the square of that part of it.
        """
        best = int(gains.argmax())
        fewer = [i for i, v in enumerate(variants)
                 if v.columns.shape[1] < variants[best].columns.shape[1]]
        owed = self.rules.rival + self.rules.bent**2 * max(gains[best], 0.0)
        simple = max(fewer, key=lambda i: gains[i], default=best)
        return simple if gains[best] - gains[simple] < owed else best

    def _best_pair(self, ranked):
        """The pair with the most evidence, None if there are not two causes; its lead over others.

        One of the likeliest is as it is alone, the other where it does best beside it: what a weak
        cause shows is not seen before the strong one is out of the way.
        """
        pairs = [self._best(cause, (one,)) for one in ranked[:self.rules.partners]
                 for cause in self._variants if cause not in one.causes]
        best = max(pairs, key=lambda pair: pair.evidence, default=None)
        return best, min((best.evidence - pair.evidence for pair in pairs
                          if set(pair.causes) != set(best.causes)), default=np.inf)

    def _candidate(self, explanations, paid):
        columns = self._of(explanations)
        B, a = self._all.normal(columns)
        covariance = np.linalg.inv(np.eye(len(a)) + B)
        gain = self._all.gain(columns)
        held_out = sum(gain - without.gain(columns) for without in self._without)
        return Candidate(explanations, gain + sum(paid), float(held_out), covariance @ a,
                         np.sqrt(np.diag(covariance)), paid, fit=0.5 * float(a @ covariance @ a))

    def _scan(self, explanations):
        U = np.hstack([self.problem.U, *(e.columns for e in explanations)])
        return scan(U, self.problem.r, self.problem.tests, self._rng,
                    together=self.problem.together)

    def _equals(self, accepted, ranked):
        """Candidates that are not told from the accepted one, each cause at its best variant.

        Full fits tell causes whose responses are alike only where they fit worse, beyond what
        their laws may have wrong; what would have to be less than nothing is no rival, nor what
        would have to be as large as it never is.
        One that predicts better what is held out is a rival, however many numbers it takes.
        Of a pair also those in which another cause has the place of either.
        """
        kept = [None]
        if len(accepted.causes) > 1:
            kept += [self._candidate((e,), (paid,)) for e, paid in
                     zip(accepted.explanations, accepted.paid, strict=True)]
        out = []
        for rest in kept:
            for one in ranked:
                if set(one.causes) & set(accepted.causes):
                    continue
                rival = one if rest is None else self._best(one.causes[0], (rest,))
                if self._all.sign(self._of(rival.explanations)) < -self.rules.rival:
                    continue
                apart = self._apart(accepted, rival)
                close = accepted.evidence - rival.evidence < self.rules.rival
                predicts = (rival.held_out - accepted.held_out >= self.rules.held_out
                            and not self._fits_better(accepted, rival))
                alike = self._alike(accepted, rival, apart) or (
                    (close or predicts) and self._claims(rival, over=rest))
                if alike and not self._gone(rival):
                    out.append(replace(rival, separation=apart))
        return tuple(out)

    def _alike(self, accepted, rival, apart):
        """True if a rival, `apart` [sd] from it, is not told from what was accepted.

        Neither by how well they fit nor by the size that it would have to have.
        """
        return (apart < self.rules.apart and not self._fits_better(accepted, rival)
                and self._lead(accepted, rival) < self.rules.certain)

    def _in_other_channels(self, accepted):
        """Candidates of its cause in other channels that are not told from a single Candidate.

        As of two sensors, whose gains are each other's inverse beside another modulus. Of a place
        in the body an interval says how well it is known; several channels that hold the accepted
        one are it and something else.
        """
        if len(accepted.explanations) > 1 or not accepted.explanations[0].channel:
            return ()
        mine, = accepted.explanations
        others, out = {}, []
        for e in self._variants[mine.cause]:
            if e.channel and not e.channel & mine.channel:
                others.setdefault(e.channel, []).append(self._candidate((e,), accepted.paid))
        for one in _sorted(max(some, key=lambda c: c.evidence) for some in others.values()):
            apart = self._apart(accepted, one)
            if apart >= self.rules.apart or self._all.sign(
                    self._of(one.explanations)) < -self.rules.rival:
                continue
            rival = self._weighed(one) if accepted.weighed else one
            if self._alike(accepted, rival, apart) and not self._gone(rival):
                out.append(replace(rival, separation=apart))
        return tuple(out)

    def _fits_better(self, accepted, rival):
        """True if full fits tell them apart: what is accepted shows beside the rival's errors."""
        return accepted.weighed and rival.weighed and (
            accepted.fit - rival.fit >= self.rules.rival) and (
            self._beyond(rival, accepted.explanations) > 0.0)

    def _lead(self, one, other):
        """By how much more evidence one Candidate has than another, weighed alike."""
        if one.weighed != other.weighed:
            one, other = (self._candidate(c.explanations, c.paid) for c in (one, other))
        return one.evidence - other.evidence

    def _apart(self, accepted, rival):
        """Separation [sd] of what was accepted, at its size, from the best its rival can do."""
        mine, other = self._of(accepted.explanations), self._of(rival.explanations)
        power = float(accepted.mean @ self._all.normal(mine)[0] @ accepted.mean)
        cross = self._all.left[np.ix_(other, mine)] @ accepted.mean
        return separation(power, cross, self._all.normal(other)[0])

    def _of(self, explanations):
        """Numbers of the columns of some explanations."""
        return np.concatenate([self._columns[id(e)] for e in explanations])


def _sorted(candidates):
    """Candidates as a tuple, the one of most evidence first."""
    return tuple(sorted(candidates, key=lambda c: -c.evidence))


def fits_ahead(judge):
    """Full fits that a Judge is likely to ask for: the promising causes, and one pair."""
    promising = sum(one.evidence >= judge.rules.promising for one in judge.singles())
    return min(promising, judge.rules.weighed) + (promising > 1)
