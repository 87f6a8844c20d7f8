"""What `arm-brachy reproduce` knows: one module per published table, figure or recording.

Each module has a NAME, as on the command line, and `reproduce(folder)`, which takes the folder
(Path, existing) for its figures and returns an evaluation Result.
"""

from arm_brachy.experiments import (
    appendix_a,
    chapter_6,
    diagnosis_laboratories,
    diagnosis_study,
    diagnosis_time,
    dome_rig,
    element_accuracy,
    estimate_feedback,
    false_alarms,
    figure_3_2,
    figure_4_5,
    figure_4_6,
    figure_4_7,
    figure_5_7,
    figure_5_8,
    figure_5_9,
    figure_5_11,
    figure_5_12,
    fit_estimators,
    import_fuzz,
    liver,
    model_verification,
    needle_force,
    node_errors,
    panda_torques,
    reduced_model,
    silicone_beam,
    single_faults,
    table_3_1,
    table_4_1,
)
from arm_brachy.experiments.dome_faults import study as dome_faults
from arm_brachy.experiments.gel_block import study as gel_block
from arm_brachy.experiments.half_cylinder import study as half_cylinder

EXPERIMENTS = {module.NAME: module.reproduce
               for module in (table_3_1, figure_3_2, model_verification, silicone_beam, dome_rig,
                             element_accuracy, reduced_model, diagnosis_study, diagnosis_time,
                             diagnosis_laboratories, dome_faults, gel_block, half_cylinder,
                             node_errors, panda_torques, table_4_1, estimate_feedback,
                             import_fuzz, false_alarms, single_faults, appendix_a,
                             figure_4_5, figure_4_6, figure_4_7,
                             figure_5_7, figure_5_8, figure_5_9, figure_5_11, figure_5_12,
                             liver, needle_force, fit_estimators,
                             chapter_6)}
