"""What was planted in each of the laboratory's recordings, and what of it an answer should say."""

from arm_brachy.experiments import laboratory
from arm_brachy.experiments.csv_files import FORCES, OPTICAL
from arm_brachy.experiments.gel_block.bodies import SHORT, SLOPE, STIFFENING
from arm_brachy.experiments.gel_block.layout import MM, SIZE, E
from arm_brachy.experiments.gel_block.recorder import Setup

HIGH, LOW = 1.15, 1 / 1.15      # modulus over the scene's: nobody's fault, and recalibrated


class Case(laboratory.Case):
    """One recording of the laboratory."""

    @property
    def modulus_kPa(self):
        """Young's modulus half way up, once what relaxes has relaxed."""
        relaxing = self.setup.memory[0] if self.setup.memory else 0.0
        return 1e-3 * E * self.setup.modulus * (1.0 - relaxing)


SLIP, ONSET = (1.2, -0.9, 0.0), 32.5            # mm, s
LATE, DRIFT = 0.060, (0.4, 0.3, 0.0)            # s, N/min
RELAXING, TAU = 0.2, 3.0                        # 1, s

CASES = (
    Case('null_1', Setup(HIGH)),
    Case('null_2', Setup(LOW)),
    Case('gain_b', Setup(HIGH, gain=(1.0, SHORT)), term='actuator_gain',
         truth={'gain': SHORT - 1.0}, place={'actuators': [1]}),
    Case('slip_m07', Setup(LOW, slip=('m07', ONSET, tuple(MM * v for v in SLIP))),
         term='marker_slip', truth={'offset_mm': SLIP, 'onset_s': ONSET},
         place={'marker': 'm07'}),
    Case('late_optical', Setup(HIGH, late={OPTICAL: LATE}), term='clock_offset',
         truth={'delay_ms': 1e3 * LATE}, place={'stream': 'optical'}),
    Case('gradient', Setup(), 'gradient', 'stiffness_gradient',
         # of the modulus half way up
         truth={'gradient_per_m': (0.0, 0.0, SLOPE / SIZE[2] / (1.0 + 0.5 * SLOPE))}),
    Case('visco', Setup(HIGH, memory=(RELAXING, TAU)), term='viscoelasticity',
         truth={'g1': RELAXING, 'tau1_s': TAU}),
    Case('debond', Setup(LOW), 'debond', 'base_debond'),
    Case('drift_b', Setup(HIGH, drift={'pad_b': tuple(v / 60.0 for v in DRIFT)}),
         term='force_drift', truth={'rate_N_min': DRIFT}, place={'pads': ['pad_b']}),
    # mu b / 4 is the second coefficient of Fung's law in Ib - 3; the term has no third
    Case('stiffening', Setup(LOW), 'stiffening', 'strain_stiffening',
         truth={'ratio': STIFFENING / 4.0}),
    Case('poor_null', Setup(HIGH, poor=True)),
    Case('late_force', Setup(1.1, late={FORCES: LATE}), term='clock_offset',
         truth={'delay_ms': 1e3 * LATE}, place={'stream': 'force'}),
)
