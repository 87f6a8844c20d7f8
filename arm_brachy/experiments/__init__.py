"""One file per published table or figure, named after it.

EXPERIMENTS : name as on the command line -> function. It takes the folder (Path, existing) for its
figures and returns an evaluation Result.
"""

from arm_brachy.experiments import figure_3_2, model_verification, table_3_1

EXPERIMENTS = {module.NAME: module.reproduce
               for module in (figure_3_2, model_verification, table_3_1)}
