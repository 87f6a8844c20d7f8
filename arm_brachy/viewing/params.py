"""What is drawn for viewers, and how often."""

from dataclasses import dataclass

from arm_brachy.core.quantity import quantity, whole, word


@dataclass(frozen=True)
class ViewerParams:
    """The drawing of the cell that `cell_viewer` publishes."""

    on: bool = word('node cell_viewer takes part in a run', default=True)
    rate: float = quantity(5.0, 'Hz', 'how often the cell is drawn', low=0.1, high=30.0,
                           source='own choice: the rate of the mesh')
    triangles: int = whole(320, 'most triangles of a surface; a finer one is drawn coarser', low=4)
    full_colour: float = quantity(10.0, 'mm', 'displacement of the last colour', low=0.01,
                                  high=500.0, source='own choice: what the pads of breast.yaml '
                                                     'move most of the surface')
    arrow: float = quantity(5.0, 'mm_N', 'length of a force', low=0.01, high=1e3,
                            source='own choice: 5 N are as long as a pad is wide')
    stale: float = quantity(0.5, 's', 'age from which on something is not drawn', low=0.05,
                            high=60.0, source='limits.needle_age')
