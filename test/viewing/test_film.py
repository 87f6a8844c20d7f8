"""A film says what the shapes said, once."""

import json

import numpy as np

from arm_brachy.viewing.film import UNIT, Film
from arm_brachy.viewing.shapes import Kind, Shape


def played(film):
    value = json.loads(film.text())
    return value, [[value['shapes'][k] for k in numbers] for _, numbers in value['frames']]


def test_coordinates_come_back_within_half_a_unit():
    points = np.random.default_rng(1).normal(size=(20, 3)) * 0.1
    film = Film(0.01)
    film.add(1.0, [Shape('a', Kind.SPHERES, points, (1, 0, 0, 1), 0.004)])
    (shape,), = played(film)[1]
    assert np.abs(np.reshape(shape['p'], (-1, 3)) * UNIT - points).max() <= UNIT / 2
    assert shape['z'] * UNIT == 0.004


def test_what_does_not_change_is_written_once(film):
    value, frames = played(film)
    assert len(value['frames']) == len(film) == 40 and len(value['meshes']) == 1
    names = [s['x'] for s in value['shapes'] if s['k'] == 'text']
    assert names == ['middle'] and all(any(s['k'] == 'text' for s in f) for f in frames)


def test_a_film_of_a_fine_surface_fits_into_a_page(film):
    assert len(film.text()) * 300 / len(film) < 10e6


def test_shades_are_a_character_a_corner():
    film = Film(0.01)
    film.add(0.0, [Shape('a', Kind.TRIANGLES, np.eye(3), (1, 1, 1, 1),
                         triangles=np.array([[0, 1, 2]]), shades=np.array([0.0, 0.5, 2.0]))])
    value, ((shape,),) = played(film)
    assert [int(c, 32) for c in shape['h']] == [0, 16, len(value['palette']) - 1]
