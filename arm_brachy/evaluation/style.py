"""How every figure looks: one palette, one set of sizes, figures without global state."""

import base64
import functools
import io
from dataclasses import dataclass

import matplotlib
from matplotlib.figure import Figure

MM = 1e3

# Okabe and Ito's palette: distinguishable with colour-blind eyes and on a grey printer
INK = '#22303c'
OURS = '#0072b2'
TRUTH = INK
MEASURED = '#7fb4d8'
GOAL = '#d55e00'
BAND = '#009e73'
THEIRS = '#cc79a7'
SERIES = ('#0072b2', '#e69f00', '#cc79a7', '#009e73', '#56b4e9', '#d55e00', '#6b6b6b', '#b8a800')

RC = {
    'font.family': 'DejaVu Sans',
    'font.size': 9.0,
    'axes.titlesize': 10.0,
    'axes.titleweight': 'bold',
    'axes.labelsize': 9.0,
    'axes.edgecolor': '#9aa5ad',
    'axes.labelcolor': INK,
    'axes.titlecolor': INK,
    'axes.spines.top': False,
    'axes.spines.right': False,
    'axes.grid': True,
    'axes.axisbelow': True,
    'grid.color': '#e6eaed',
    'grid.linewidth': 0.7,
    'xtick.color': INK,
    'ytick.color': INK,
    'text.color': INK,
    'lines.linewidth': 1.5,
    'legend.frameon': False,
    'legend.fontsize': 8.5,
    'savefig.dpi': 150,
    'svg.hashsalt': 'arm_brachy',
}


@dataclass(frozen=True)
class Plate:
    """A figure with its name (a file stem) and its caption in words."""

    name: str
    figure: Figure
    caption: str

    def save(self, path):
        """Write to `path`; the suffix (.svg, .png, .pdf) chooses the form."""
        _save(self.figure, path, str(path).rsplit('.', 1)[-1])

    def data_uri(self):
        """The figure as an SVG inside a data URI, for a page that must stand alone."""
        buffer = io.BytesIO()
        _save(self.figure, buffer, 'svg')
        return 'data:image/svg+xml;base64,' + base64.b64encode(buffer.getvalue()).decode()


def styled(draw):
    """Run a drawing function under the house style, leaving matplotlib's own settings alone."""
    @functools.wraps(draw)
    def wrapper(*args, **kwargs):
        with matplotlib.rc_context(RC):
            return draw(*args, **kwargs)
    return wrapper


def new_figure(width, height):
    """An empty figure, size in inches, laid out without overlaps."""
    return Figure(figsize=(width, height), layout='constrained')


def colour(index):
    """The colour of the index-th actuator, pad or marker."""
    return SERIES[index % len(SERIES)]


@styled
def _save(figure, target, kind):
    # no date inside: the same data give the same file
    metadata = {'Date': None} if kind == 'svg' else None
    figure.savefig(target, format=kind, metadata=metadata)
