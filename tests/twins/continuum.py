"""Twin of elastic cells: plane stress of a polygon under forces per area, by fine linear triangles."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import shapely
from scipy.sparse.linalg import spsolve
from scipy.spatial import Delaunay, cKDTree

YOUNGS, POISSON = 5e6, 0.3


def mesh(shape, side):
    """Nodes on a triangular lattice and along the outline, and the triangles inside of it, counter-clockwise."""
    west, south, east, north = shape.bounds
    x, y = np.meshgrid(np.arange(west, east + side, side), np.arange(south, north + side, side * np.sqrt(0.75)))
    x = x + 0.5 * side * (np.arange(len(x)) % 2)[:, None]
    inner = np.column_stack([x.ravel(), y.ravel()])
    inner = inner[shapely.contains_xy(shape.buffer(-0.45 * side), inner)]
    nodes = np.vstack([inner, np.asarray(shape.exterior.segmentize(side).coords)[:-1]])
    triangle = Delaunay(nodes).simplices
    a, b, c = nodes[triangle].transpose(1, 0, 2)
    area = 0.5 * ((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]))
    triangle[area < 0] = triangle[area < 0][:, ::-1]
    kept = (abs(area) > 1e-3 * side**2) & shapely.contains_xy(shape, nodes[triangle].mean(axis=1))
    return nodes, triangle[kept], abs(area)[kept]


def largest_tension(shape, force, thickness, side, over=0.0):
    """Largest principal tension (Pa) of a free body that accelerates as a rigid one; ``force``: N m-2 at x and y (m).

    ``over``: side (m) of the squares of ice over which stress is averaged, as the cells of a lattice do; 0: at points.
    """
    nodes, triangle, area = mesh(shape, side)
    place, count = nodes[triangle], 2 * len(nodes)
    x, y = place[..., 0], place[..., 1]
    strain = np.zeros((len(triangle), 3, 6))
    strain[:, 0, 0::2] = strain[:, 2, 1::2] = (y[:, [1, 2, 0]] - y[:, [2, 0, 1]]) / (2 * area[:, None])
    strain[:, 1, 1::2] = strain[:, 2, 0::2] = (x[:, [2, 0, 1]] - x[:, [1, 2, 0]]) / (2 * area[:, None])
    hooke = np.array([[1, POISSON, 0], [POISSON, 1, 0], [0, 0, (1 - POISSON) / 2]]) * YOUNGS / (1 - POISSON**2)
    block = np.einsum("tji,jk,tkl,t->til", strain, hooke, strain, area * thickness)
    at = np.stack([2 * triangle, 2 * triangle + 1], axis=2).reshape(-1, 6)
    rows, columns = np.repeat(at, 6, axis=1).ravel(), np.tile(at, (1, 6)).ravel()
    stiffness = sp.coo_matrix((block.ravel(), (rows, columns)), (count, count)).tocsc()

    load, mass = np.zeros((len(nodes), 2)), np.zeros(len(nodes))
    pull = np.column_stack(force(*place.mean(axis=1).T)) * area[:, None] / 3
    for k in range(3):
        np.add.at(load, triangle[:, k], pull)
        np.add.at(mass, triangle[:, k], area / 3)
    away = nodes - mass @ nodes / mass.sum()
    load -= mass[:, None] * load.sum(axis=0) / mass.sum()
    turning = (away[:, 0] * load[:, 1] - away[:, 1] * load[:, 0]).sum() / (mass @ (away**2).sum(axis=1))
    load -= turning * mass[:, None] * np.column_stack([-away[:, 1], away[:, 0]])

    soft = sp.diags(np.full(count, 1e-9 * stiffness.diagonal().max()))  # takes up the rigid motion
    moved = spsolve(stiffness + soft, load.ravel())
    stress = np.einsum("ij,tjk,tk->ti", hooke, strain, moved[at])
    at_node = np.zeros((len(nodes), 3))
    for k in range(3):
        np.add.at(at_node, triangle[:, k], stress * area[:, None] / 3)
    used = mass > 0.0  # where outlines are sharp a node may have no triangle
    nodes, mass, at_node = nodes[used], mass[used], at_node[used] / mass[used, None]
    if over > 0.0:
        near = cKDTree(nodes).query_ball_point(nodes, over / np.sqrt(np.pi))
        at_node = np.array([mass[ring] @ at_node[ring] / mass[ring].sum() for ring in near])
    xx, yy, xy = at_node.T
    return float((0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy)).max())
