"""Scatterers in a mesh: the speckle of plain tissue, moved and strained with the elements."""

import numpy as np
import pytest
from scipy import stats

from arm_brachy.core.errors import ConfigError
from arm_brachy.devices.speckle import EchoRegion, TissueScatterers
from arm_brachy.devices.ultrasound import ImageFormer, UltrasoundParams

PARAMS = UltrasoundParams()
FORMER = ImageFormer(PARAMS)
SY = PARAMS.sigma[1]
RIM = 20
# Kuhn's six tetrahedra of a cube, whose corners are numbered by x + 2 y + 4 z.
_KUHN = np.array([[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7],
                  [0, 5, 1, 7]])
_EDGES = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]


def block(low, high, cells, quadratic=True):
    """Nodes and elements of a block cut into cells, each into six tetrahedra."""
    axes = [np.linspace(a, b, n + 1) for a, b, n in zip(low, high, cells, strict=True)]
    nodes = np.stack(np.meshgrid(*axes, indexing='ij'), axis=-1).reshape(-1, 3)
    number = np.arange(len(nodes)).reshape([n + 1 for n in cells])
    corners = np.array([number[i:i + 2, j:j + 2, k:k + 2].transpose(2, 1, 0).ravel()
                        for i, j, k in np.ndindex(*cells)])
    tets = corners[:, _KUHN].reshape(-1, 4)
    if not quadratic:
        return nodes, tets
    pairs = np.sort(tets[:, _EDGES], axis=2).reshape(-1, 2)
    edges, which = np.unique(pairs, axis=0, return_inverse=True)
    return (np.vstack([nodes, nodes[edges].mean(axis=1)]),
            np.hstack([tets, len(nodes) + which.reshape(-1, 6)]))


NODES, ELEMENTS = block([-0.022, -4 * SY, -0.003], [0.022, 4 * SY, 0.041], (5, 1, 5))


def body(seed, regions=()):
    return TissueScatterers(NODES, ELEMENTS, PARAMS.density, regions, np.random.default_rng(seed))


def test_their_number_is_that_of_the_density_and_they_are_even():
    there = body(0)
    volume = np.prod(NODES.max(axis=0) - NODES.min(axis=0))
    mean = PARAMS.density * volume
    assert abs(there.count.sum() - mean) < 4 * np.sqrt(mean)
    pool = np.column_stack([1.0 - there.pool[:, :3].sum(axis=1), there.pool[:, :3]])
    assert pool.min() >= -1e-6
    # Barycentric coordinates of an even distribution, Dirichlet(1, 1, 1, 1).
    assert np.allclose(pool.mean(axis=0), 0.25, atol=1e-3)
    assert np.allclose(pool.var(axis=0), 3.0 / 80.0, rtol=5e-3)
    assert abs(there.pool[:, 3].mean()) < 4e-3


def test_speckle_of_a_mesh_is_rayleigh_distributed():
    ratios, samples = [], []
    apart = (3.0 * PARAMS.sigma[[2, 0]] / PARAMS.pixel[::-1]).astype(int)
    for seed in range(4):
        image = FORMER.tissue(body(seed), NODES)[0][RIM:-RIM, RIM:-RIM]
        ratios.append(image.mean() / image.std())
        samples.append(image[::apart[0], ::apart[1]].ravel())
        assert np.isclose(np.mean(image**2), 1.0, rtol=0.08)
    assert 1.87 < np.mean(ratios) < 1.95
    first = samples[0] / np.sqrt(np.mean(samples[0]**2) / 2.0)
    assert stats.kstest(first, stats.rayleigh.cdf).pvalue > 0.05


def correlation(a, b):
    a, b = (s[..., 0] + 1j * s[..., 1] for s in (a, b))
    return np.abs(np.vdot(a, b)) / np.sqrt(np.vdot(a, a).real * np.vdot(b, b).real)


def signal(scatterers, nodes, former=FORMER):
    return former.tissue_signal(scatterers, nodes)[0]


@pytest.mark.parametrize('shift', [0.5, 1.0])
def test_it_decorrelates_when_the_mesh_moves_across_the_plane(shift):
    there = body(1)
    before, after = (signal(there, NODES + [0.0, d * SY, 0.0])[RIM:-RIM, RIM:-RIM]
                     for d in (0.0, shift))
    assert np.isclose(correlation(before, after), np.exp(-shift**2 / 4.0), atol=0.03)


@pytest.mark.parametrize('strain', [0.02, 0.05])
def test_it_decorrelates_with_the_strain_of_the_mesh(strain):
    """exp(-(2 k e sz)^2 / 4) at the depth that does not move."""
    middle, found = 0.02, []
    v, sums = round(middle / PARAMS.pixel[1]), np.zeros(3, dtype=complex)
    middle = v * PARAMS.pixel[1]
    strained = NODES.copy()
    strained[:, 2] = middle + (1.0 + strain) * (NODES[:, 2] - middle)
    for seed in range(10):
        there = body(seed)
        a, b = (signal(there, x)[v, 10:-10] for x in (NODES, strained))
        a, b = a[:, 0] + 1j * a[:, 1], b[:, 0] + 1j * b[:, 1]
        sums += [np.vdot(a, b), np.vdot(a, a), np.vdot(b, b)]
    found = np.abs(sums[0]) / np.sqrt(sums[1].real * sums[2].real)
    k = 2.0 * np.pi * PARAMS.frequency / PARAMS.sound
    assert np.isclose(found, np.exp(-(2.0 * k * strain * PARAMS.sigma[2])**2 / 4.0), atol=0.1)


def test_a_region_stays_with_its_material_and_has_its_level():
    there = body(2, [EchoRegion((-0.009, 0.0, 0.02), 0.006, 0.0),
                     EchoRegion((0.009, 0.0, 0.02), 0.006, 2.0)])
    shift = np.array([0.004, 0.0, 0.003])
    image, plain = FORMER.tissue(there, NODES + shift)[0], FORMER.tissue(body(2), NODES + shift)[0]
    v = round(0.023 / PARAMS.pixel[1])
    (cyst, _), (lump, before) = ([i[v - 25:v + 25, c - 35:c + 35] for i in (image, plain)]
                                 for c in (round(319.5 + x / PARAMS.pixel[0])
                                           for x in (-0.005, 0.013)))
    assert cyst.max() < 0.05
    assert np.isclose(10 * np.log10(np.mean(lump**2) / np.mean(before**2)), 6.02, atol=0.2)


def test_quadratic_elements_follow_a_bent_mesh():
    """An image of curved elements is that of scatterers moved one by one."""
    fine = block([-0.022, -4 * SY, -0.003], [0.022, 4 * SY, 0.041], (10, 1, 10), quadratic=False)

    def bent(x):
        return x + np.column_stack([0.0 * x[:, 0], 0.0 * x[:, 0], 10.0 * x[:, 0]**2])

    def moments(nodes, elements, density):
        there = TissueScatterers(nodes, elements, density, (), np.random.default_rng(0))
        return FORMER.tissue(there, bent(nodes))[1]

    coarse, refined = moments(NODES, ELEMENTS, 4e9), moments(*fine, 4e9)
    assert abs(coarse - refined) < 5 * np.sqrt(coarse + refined)


def test_same_seed_same_bits():
    a, b = (FORMER.compress(FORMER.tissue(body(5), NODES)[0]) for _ in range(2))
    assert np.array_equal(a, b)


def test_far_from_the_body_nothing_is_seen():
    image, seen = FORMER.tissue(body(3), NODES + [0.0, 0.1, 0.0])
    assert seen == 0 and image.max() == 0.0


def test_an_element_with_more_scatterers_than_the_pool_is_refused():
    """A cube of 6 cm in six tetrahedra of 36 cm3, 1.08 million scatterers each."""
    nodes, elements = block([0, 0, 0], [0.06, 0.06, 0.06], (1, 1, 1), quadratic=False)
    with pytest.raises(ConfigError, match='an element of 36 cm3 holds .* scatterers; must be'):
        TissueScatterers(nodes, elements, PARAMS.density, (), np.random.default_rng(0))
