"""Wind at the blades and the tower: where it is asked for, and what of it they feel."""

from wt_gym.aerodynamics.bodies.tower_kernels import add_tower_flow
from wt_gym.compiled import kernel


@kernel(fastmath=False)
def points_ahead(nodes, velocities, earlier, dt, points):
    """Where the lattice will be in ``dt`` [s], by Adams-Bashforth, into the first points (n, 3).

    That is 5 cm from where it comes to be, less than the wind resolves. ``earlier`` receives the velocities.
    """
    for i in range(nodes.shape[0]):
        for c in range(3):
            points[i, c] = nodes[i, c] + dt * (1.5 * velocities[i, c] - 0.5 * earlier[i, c])
            earlier[i, c] = velocities[i, c]


@kernel(fastmath=False)
def felt_wind(wind, points, shadow, wake_flow, base, top, stations, radii, blades, tower):
    """Undisturbed wind at the points of blades, then tower, to what blades and tower feel; whether it is finite.

    Parameters
    ----------
    wind, points : (n_node + n_tower, 3)
        [m/s], [m].
    shadow : bool
        Whether the blades feel the flow past the tower. The tower stands in a wind that the rotor has slowed; the
        undisturbed one would double its effect.
    wake_flow : (3, n)
        Velocity of the wake at points all over the rotor, by the mean of which the wind is slowed [m/s].
    base, top : (3,)
        Ends of the tower [m].
    stations, radii : (n,)
        Of the tower, see `add_tower_flow`.
    blades : (n_node, 3)
        Receives the wind at the nodes of the blades.
    tower : (n_tower, 3)
        Receives the wind at the tower.
    """
    total, n_node = 0.0, blades.shape[0]
    for i in range(wind.shape[0]):
        for c in range(3):
            total += wind[i, c]
            if i < n_node:
                blades[i, c] = wind[i, c]
            else:
                tower[i - n_node, c] = wind[i, c]
    if shadow:
        for sign in (1.0, -1.0):
            for c in range(3):
                slowed = 0.0
                for i in range(wake_flow.shape[1]):
                    slowed += wake_flow[c, i]
                slowed *= sign / wake_flow.shape[1]
                for i in range(n_node):
                    blades[i, c] += slowed
            if sign > 0.0:
                add_tower_flow(points[:n_node], blades, base, top, stations, radii)
    return total - total == 0.0
