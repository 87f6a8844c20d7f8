"""The stage that a page plays films on, as text: no page that holds it asks for another file."""

from html import escape
from importlib.resources import files

PLAYER = """<div class="stage" id="{name}"><div class="view"><canvas class="solid"></canvas>
<canvas class="names"></canvas><div class="layers"></div>
<div class="legend">displacement 0<i></i><b></b></div></div>
<div class="controls"><button class="play" type="button">Play</button>
<input type="range" min="0" max="0" value="0" aria-label="time"><output></output></div></div>"""


def script():
    """Text of stage.js."""
    return _asset('stage.js')


def style():
    """Text of stage.css."""
    return _asset('stage.css')


def player(name):
    """HTML of a stage with its controls, id `name`."""
    return PLAYER.format(name=name)


def data_script(name, text):
    """HTML that holds JSON text as data, id `name`; nothing in it can end the element early."""
    safe = text.replace('<', '\\u003c')
    return f'<script type="application/json" id="{name}">{safe}</script>'


def film_block(name, text):
    """HTML of a whole film that plays by itself: player, data, style and script.

    name : id, letters only;  text : JSON of `film.Film.text`
    """
    return (f'<style>{style()}</style>{player(name)}{data_script(f"{name}_film", text)}'
            f'<script>{script()}\nwindow.{name}_player = playFilm(document.getElementById('
            f'"{name}"), JSON.parse(document.getElementById("{name}_film").textContent));'
            '</script>')


def view_page(title, about, text, controls='', script_end='openView(DATA);'):
    """HTML of the page of `arm-brachy view`.

    about : one line under the title;  text : JSON of a film with `plots` and `pictures`
    controls : HTML above the picture;  script_end : JavaScript that opens DATA
    """
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>
<link rel="icon" href="data:,"><style>{_asset('view.css')}{style()}</style></head>
<body><header><h1>{escape(title)}</h1><p>{escape(about)}</p></header>
<main>{player('run')}<aside>{controls}
<figure id="picture"><figcaption>ultrasound</figcaption><img alt="ultrasound picture"></figure>
</aside></main>{data_script('data', text)}
<script>{script()}{_asset('view.js')}
const DATA = JSON.parse(document.getElementById('data').textContent);
{script_end}</script></body></html>"""


def _asset(name):
    return (files('arm_brachy.viewing.page') / name).read_text(encoding='utf-8')
