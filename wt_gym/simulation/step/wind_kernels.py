"""Wind at the blades and the tower: where it is asked for, and what of it they feel."""

from wt_gym.aerodynamics.bodies.tower_kernels import add_tower_flow
from wt_gym.aerodynamics.wake.wake_kernels import rows_for_wind, store_wind, velocity_behind_disc
from wt_gym.base.compiled import kernel


@kernel(fastmath=False)
def ask_for_wind(wake, shed, n_rows, n_steps, stride, rows, row_points, nodes, velocities, earlier, dt, work, hub,
                 points):  # fmt: skip
    """Where a step needs the wind: at rows of the wake, and where the blades and the hub will be at its end.

    Parameters
    ----------
    wake, shed, n_rows, n_steps, stride, rows, row_points
        See `rows_for_wind`.
    nodes, velocities, earlier, dt, points
        See `points_ahead`; the last of the points is the hub, those before it belong to the tower, which stays.
    work : Work
        With the kinematics of now.
    hub : int
        Body.

    Returns
    -------
    int
        Number of the rows.
    """
    points_ahead(nodes, velocities, earlier, dt, points)
    last = points.shape[0] - 1
    for c in range(3):
        points[last, c] = work.r[hub, c]
        for d in range(3):
            points[last, c] += dt * work.rot[hub, c, d] * work.v[hub, d]
    return rows_for_wind(wake, shed, n_rows, n_steps, stride, rows, row_points)


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
def receive_wind(row_wind, rows, wake_wind, wind, points, shadow, air, work, rotor, slowing, base, top, stations,
                 radii, blades, tower, hub):  # fmt: skip
    """What `ask_for_wind` has asked for, to the wake and to blades, tower and hub; whether it is finite.

    Parameters
    ----------
    row_wind, rows, wake_wind
        See `store_wind`.
    wind, points, shadow, air, work, rotor, slowing, base, top, stations, radii, blades, tower, hub
        See `felt_wind`.
    """
    finite = store_wind(row_wind, rows, wake_wind)
    felt = felt_wind(wind, points, shadow, air, work, rotor, slowing, base, top, stations, radii, blades, tower, hub)
    return felt and finite


@kernel(fastmath=False)
def felt_wind(wind, points, shadow, air, work, rotor, slowing, base, top, stations, radii, blades, tower, hub):
    """Undisturbed wind at the points of blades, tower and hub, to what they feel; whether it is finite.

    Parameters
    ----------
    wind, points : (n_node + n_tower + 1, 3)
        [m/s], [m].
    shadow : bool
        Whether the blades feel the flow past the tower. The tower stands in a wind that the rotor has slowed, by a
        third near the optimum.
    air : AeroArrays
    work : Work
        With the kinematics of now.
    rotor : int
        Body of the hub.
    slowing : (3,)
        Receives what the rotor adds to the wind at the tower [m/s], see `velocity_behind_disc`.
    base, top : (3,)
        Ends of the tower [m].
    stations, radii : (n,)
        Of the tower, see `add_tower_flow`.
    blades : (n_node, 3)
        Receives the wind at the nodes of the blades.
    tower : (n_tower, 3)
        Receives the wind at the tower.
    hub : (3,)
        Receives the wind at the hub.
    """
    total, n_node, last = 0.0, blades.shape[0], wind.shape[0] - 1
    for c in range(3):
        for i in range(last + 1):
            total += wind[i, c]
        for i in range(n_node):
            blades[i, c] = wind[i, c]
        for i in range(n_node, last):
            tower[i - n_node, c] = wind[i, c]
        hub[c] = wind[last, c]
    if shadow:
        velocity_behind_disc(air.wake, air.induced, air.age, air.n_rows, work.r[rotor], work.rot[rotor, :, 0],
                             work.omega[rotor, 0], slowing)  # fmt: skip
        for i in range(n_node):
            for c in range(3):
                blades[i, c] += slowing[c]
        add_tower_flow(points[:n_node], blades, base, top, stations, radii)
        for i in range(n_node):
            for c in range(3):
                blades[i, c] -= slowing[c]
    return total - total == 0.0
