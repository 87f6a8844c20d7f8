"""When the diagnosis claims something, and what a sound laboratory leaves uncalibrated.

Test: diagnosis/test_decide.py, diagnosis/test_finding.py
"""

from dataclasses import dataclass

from arm_brachy.core.quantity import quantity


@dataclass(frozen=True)
class Rules:
    """When to claim. Evidence and scores are natural logarithms of probability ratios."""

    evidence: float = quantity(6.0, '', 'least gain in evidence of a cause', low=0.0, high=1e3,
                               source='own choice: of one number known to a tenth of its prior, '
                               'z > 4.1: by chance in thirty causes 0.1 %, at most e^-6 each '
                               '(Markov)')
    held_out: float = quantity(2.3, '', 'least gain in predicting kinds held out', low=0.0,
                               high=1e3, source='own choice: odds of 10')
    certain: float = quantity(15.0, '', 'gain in evidence, less what kinds held out lose by it, '
                              'of what they need not show: what is there at rest, or is '
                              'calibrated to less, is learnt from any', low=0.0, high=1e4,
                              source='own choice: 5.5 standard deviations')
    gainsaid: float = quantity(0.2, '', 'part of its evidence that what is certain may lose on '
                               'kinds held out', low=0.0, high=1.0,
                               source='own choice: of a sag of 0.5 mm that was planted, 0.12 were '
                               "lost by 10 um of its second order in a push, which is a law's")
    rival: float = quantity(4.0, '', 'least lead in evidence over a rival that is alike',
                            low=0.0, high=1e3, source='own choice: odds of 50')
    apart: float = quantity(3.0, '', 'separation below which two causes are one class [sd]',
                            low=0.0, high=100.0,
                            source='own choice: three standard deviations')
    alarm: float = quantity(1e-3, '', 'chance of a structured test below which something is left',
                            low=1e-6, high=0.5, source='own choice: one in a thousand')
    bent: float = quantity(0.05, '', 'part of an effect that its response may have wrong',
                           low=0.0, high=1.0, source='own choice: as much as any law; of a '
                           'relaxation by a third, planted with one branch, a second one took 20 '
                           'of 65145 nats, 1.8 % of the effect')
    partners: int = 12   # causes, best first, that are tried in pairs
    alone: int = 3       # causes, best first, that are fitted in full alone
    weighed: int = 4     # causes, best first, whose full fits are compared
    hopeless: float = quantity(0.1, '', 'part of the evidence of the first cause, by responses, '
                               'below which another one is not fitted in full', low=0.0, high=1.0,
                               source='own choice: a full fit has gained 2.6 times the evidence '
                               'of its response, of a skin where tissue stiffened')
    promising: float = quantity(3.0, '', 'least gain in evidence by its response of a cause that '
                                'is fitted in full', low=0.0, high=1e3,
                                source='own choice: odds of 20')


@dataclass(frozen=True)
class FindingRules:
    """When a finding without a tissue model is told as a cause without asking the model."""

    prior: float = quantity(0.01, '', 'odds that a thing that is tested is at fault', low=1e-6,
                            high=1.0, source='own choice: one fault in some hundred channels and '
                            'clocks that are tested')
    told: float = quantity(0.95, '', 'least probability of a finding that is a cause', low=0.5,
                           high=1.0, source='own choice: one wrong claim in twenty')


@dataclass(frozen=True)
class Calibration:
    """Standard deviations of what a laboratory that did nothing wrong leaves uncalibrated.

    An estimate is a fault only if it exceeds its own error and this together.
    """

    clock: float = quantity(2.0, 'ms', 'offset between the clocks of two streams', low=0.0,
                            high=1e3, source='own choice: streams stamped on one computer')
    gain: float = quantity(0.003, '', 'scale of an actuator or of its pad marker', low=0.0,
                           high=1.0, source='own choice: lead of a rolled screw, 0.3 %')
    play: float = quantity(0.02, 'mm', 'lost motion at a reversal', low=0.0, high=10.0,
                           source='own choice: two counts of a 12 bit encoder over 50 mm')
    compliance: float = quantity(0.01, 'mm_N', 'yield of an actuator', low=0.0, high=10.0,
                                 source='own choice: 100 N/mm is stiff for a bench')
    placement: float = quantity(0.3, 'mm', 'place of a marker on its body, per axis', low=0.0,
                                high=100.0, source='own choice: glued by hand to a drawing')
    scale: float = quantity(0.001, '', 'scale of an optical tracker', low=0.0, high=1.0,
                            source='own choice: calibration wand measured to 0.25 mm in 240 mm')
    em_registration: float = quantity(0.2, 'mm', 'zero of an EM tracker, and place of its '
                                      'sensor in the body, per axis', low=0.0, high=100.0,
                                      source='own choice: a shift of up to 0.5 mm')
    force_zero: float = quantity(0.03, 'N', 'zero of a force sensor, per axis', low=0.0,
                                 high=100.0, source='own choice: tared to one or two counts')
    force_gain: float = quantity(0.01, '', 'scale of a force sensor', low=0.0, high=1.0,
                                 source='own choice: hung with a few weights of 0.5 % each')
    sensor_axes: float = quantity(0.5, 'deg', 'turn of the axes of a force sensor, about each',
                                  low=0.0, high=90.0, source='own choice: screwed on to a stop; '
                                                             'as much as cross-talk of 1 %')
    force_drift: float = quantity(0.02, 'N_min', 'drift of a force sensor, per axis', low=0.0,
                                  high=100.0, source='own choice: 0.1 % of 20 N per minute')
    touch: float = quantity(0.2, 'mm', 'pad position where the encoder says zero', low=0.0,
                            high=10.0, source='own choice: where a pad first touches soft '
                                              'tissue, found by eye')
    direction: float = quantity(0.5, 'deg', 'direction of a push', low=0.0, high=90.0,
                                source='own choice: aligned by eye to a drawing')
    slip: float = quantity(0.01, 'mm', 'sudden step of a marker or pad, per axis', low=0.0,
                           high=10.0, source='own choice: glue and slides settle by microns')
    base: float = quantity(0.02, 'mm', 'motion of the base plate, per axis', low=0.0, high=10.0,
                           source='own choice: a bench that gives way a little')
    restless: float = quantity(0.02, 'mm', 'amplitude of a rhythm', low=0.0, high=10.0,
                               source='own choice: pumps and footsteps on a laboratory floor')
