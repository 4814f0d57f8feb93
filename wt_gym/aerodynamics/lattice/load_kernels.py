"""Loads of the air on the ring nodes: Joukowski's force on segments, Bernoulli's pressure on panels, profile drag."""

import numpy as np

from wt_gym.aerodynamics.lattice.section_kernels import linear_at
from wt_gym.aerodynamics.lattice.separation_kernels import separation_drag
from wt_gym.base.compiled import kernel


@kernel(fastmath=False)
def _push(forces, b, i, j, fx, fy, fz):
    forces[b, i, j, 0] += fx
    forces[b, i, j, 1] += fy
    forces[b, i, j, 2] += fz


@kernel(fastmath=False)
def _push_ring(forces, b, i, j, fore, fx, fy, fz):
    """Force at the middle of a strip between the spanwise sides of ring (i, j), ``fore`` of it on the leading one."""
    for side in range(2):
        h = 0.5 * fore
        _push(forces, b, i, j + side, h * fx, h * fy, h * fz)
        h = 0.5 - h
        _push(forces, b, i + 1, j + side, h * fx, h * fy, h * fz)


@kernel(fastmath=False)
def spanwise_strength(gamma, b, i, j, edge_wake):
    """Net circulation of the spanwise segment in front of ring row i; nothing where the wake continues the ring."""
    n_chord = gamma.shape[1]
    strength = 0.0
    if i < n_chord:
        strength += gamma[b, i, j]
    if i > 0 and not (i == n_chord and edge_wake):
        strength -= gamma[b, i - 1, j]
    return strength


@kernel(fastmath=False)
def chordwise_strength(gamma, b, i, j, tip_wake):
    """Net circulation, directed aft, of the chordwise segment at node column j."""
    n_span = gamma.shape[2]
    strength = 0.0
    if j > 0 and not (j == n_span and tip_wake):
        strength += gamma[b, i, j - 1]
    if j < n_span:
        strength -= gamma[b, i, j]
    return strength


@kernel(fastmath=False, inline="always")
def joukowski_loads(nodes, gamma, rate, flow, normal, area, density, edge_wake, tip_wake, forces):
    """Joukowski force rho G V x l of every bound segment and the force of the changing circulation, at the nodes.

    flow (3, n_point) is the whole local velocity at the segment midpoints, rate = d gamma / dt (n_ring,). Of the last
    ring of a strip, which ends a quarter panel behind the trailing edge, one half counts: three quarters lie on the
    blade, and Joukowski's sum lacks the vorticity -rate/V that the last quarter of the chord carries into the wake.
    """
    n_blade, n_row, n_node, _ = nodes.shape
    n_chord, n_span = n_row - 1, n_node - 1
    n_ring = n_blade * n_chord * n_span
    line_rows = n_chord if edge_wake else n_row
    r, s, k = 0, n_ring, n_ring + n_blade * line_rows * n_span
    for b in range(n_blade):
        for i in range(n_row):
            for j in range(n_span):
                if i < line_rows:
                    lx = nodes[b, i, j + 1, 0] - nodes[b, i, j, 0]
                    ly = nodes[b, i, j + 1, 1] - nodes[b, i, j, 1]
                    lz = nodes[b, i, j + 1, 2] - nodes[b, i, j, 2]
                    u, v, w = flow[0, s], flow[1, s], flow[2, s]
                    h = 0.5 * density * spanwise_strength(gamma, b, i, j, edge_wake)
                    fx, fy, fz = h * (v * lz - w * ly), h * (w * lx - u * lz), h * (u * ly - v * lx)
                    _push(forces, b, i, j, fx, fy, fz)
                    _push(forces, b, i, j + 1, fx, fy, fz)
                    s += 1
                if i < n_chord:
                    part = 0.5 if i == n_chord - 1 else 1.0
                    h = density * rate[r] * area[r] * part
                    _push_ring(forces, b, i, j, 1.0 - 0.5 * part, h * normal[r, 0], h * normal[r, 1], h * normal[r, 2])
                    r += 1
            if i < n_chord:
                for j in range(n_node):
                    lx = nodes[b, i + 1, j, 0] - nodes[b, i, j, 0]
                    ly = nodes[b, i + 1, j, 1] - nodes[b, i, j, 1]
                    lz = nodes[b, i + 1, j, 2] - nodes[b, i, j, 2]
                    u, v, w = flow[0, k], flow[1, k], flow[2, k]
                    h = 0.5 * density * chordwise_strength(gamma, b, i, j, tip_wake)
                    fx, fy, fz = h * (v * lz - w * ly), h * (w * lx - u * lz), h * (u * ly - v * lx)
                    _push(forces, b, i, j, fx, fy, fz)
                    _push(forces, b, i + 1, j, fx, fy, fz)
                    k += 1


@kernel(fastmath=False, inline="always")
def bernoulli_loads(nodes, gamma, rate, flow, normal, area, density, edge_wake, tip_wake, forces):
    """Pressure jump of every panel along its normal, at the nodes (Gebhardt et al. 2012, section 3).

    With the vorticity vector of a panel w = sum of G l over its sides, half of each side that it shares with a
    neighbor, the jump of the tangential velocity is w x n / A and the unsteady Bernoulli equation gives the force
    rho (V . (w x n) + A d gamma/dt) n, V being the mean velocity at the collocation point. The suction at the
    leading edge, which lies in the panels' planes, is missing. The panel lies a quarter of its chord before its ring.
    """
    n_blade, n_row, n_node, _ = nodes.shape
    n_chord, n_span = n_row - 1, n_node - 1
    r = 0
    for b in range(n_blade):
        for i in range(n_chord):
            for j in range(n_span):
                wx, wy, wz = 0.0, 0.0, 0.0
                for side in range(2):
                    shared = 1.0 if i + side == 0 or i + side == n_chord else 0.5
                    g = shared * spanwise_strength(gamma, b, i + side, j, edge_wake)
                    wx += g * (nodes[b, i + side, j + 1, 0] - nodes[b, i + side, j, 0])
                    wy += g * (nodes[b, i + side, j + 1, 1] - nodes[b, i + side, j, 1])
                    wz += g * (nodes[b, i + side, j + 1, 2] - nodes[b, i + side, j, 2])
                    shared = 1.0 if j + side == 0 or j + side == n_span else 0.5
                    g = shared * chordwise_strength(gamma, b, i, j + side, tip_wake)
                    wx += g * (nodes[b, i + 1, j + side, 0] - nodes[b, i, j + side, 0])
                    wy += g * (nodes[b, i + 1, j + side, 1] - nodes[b, i, j + side, 1])
                    wz += g * (nodes[b, i + 1, j + side, 2] - nodes[b, i, j + side, 2])
                nx, ny, nz = normal[r, 0], normal[r, 1], normal[r, 2]
                jump = (flow[0, r] * (wy * nz - wz * ny) + flow[1, r] * (wz * nx - wx * nz)
                        + flow[2, r] * (wx * ny - wy * nx))  # fmt: skip
                part = 0.5 if i == n_chord - 1 else 1.0  # see `joukowski_loads`
                h = density * (jump + part * area[r] * rate[r])
                _push_ring(forces, b, i, j, 0.75, h * nx, h * ny, h * nz)
                r += 1


@kernel(fastmath=False, inline="always")
def viscous_loads(nodes, fore_aft, normal, width, alpha, speed, p, separation, density, forces):
    """Drag at the quarter chord and pitching moment as a couple of the first and last node row, from the polars.

    ``separation`` (n_strip,) are the separation points of the dynamic stall model, negative for static polars.
    The lattice already carries the moment of its own camber line, ``moment0`` at zero lift; only the rest is added.
    """
    n_blade, n_row, n_node, _ = nodes.shape
    n_chord, n_span = n_row - 1, n_node - 1
    quarter = 0.25 * n_chord - 0.25
    row = min(int(quarter), n_chord - 1)
    aft = quarter - row
    for b in range(n_blade):
        for j in range(n_span):
            k = b * n_span + j
            own = k % p.polars.shape[0]
            cd = linear_at(p.polars[own], 1, alpha[k]) + separation_drag(p.separation[own], separation[k], alpha[k])
            cm = linear_at(p.polars[own], 2, alpha[k])
            pressure = 0.5 * density * speed[k] * speed[k] * p.chord[j] * width[k]
            angle = alpha[k] - p.slope_angle[j]
            arm = 0.0
            for c in range(3):
                arm += 0.5 * fore_aft[k, c] * (nodes[b, n_chord, j, c] + nodes[b, n_chord, j + 1, c]
                                               - nodes[b, 0, j, c] - nodes[b, 0, j + 1, c])  # fmt: skip
            couple = 0.5 * pressure * p.chord[j] * (cm - p.moment0[j] * np.cos(alpha[k]) ** 2) / arm
            for c in range(3):
                drag = 0.5 * pressure * cd * (np.cos(angle) * fore_aft[k, c] + np.sin(angle) * normal[k, c])
                for side in range(2):
                    forces[b, row, j + side, c] += (1.0 - aft) * drag
                    forces[b, row + 1, j + side, c] += aft * drag
                    forces[b, 0, j + side, c] += couple * normal[k, c]
                    forces[b, n_chord, j + side, c] -= couple * normal[k, c]
