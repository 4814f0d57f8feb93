/* Numbers of the turbine, the controller and the agent come first, then the laws. All that is remembered from call to
 * call lies in one structure, one instance a loaded library. Angles are in rad, everything is in SI units. */

#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* DATA */

static const double PI = 3.14159265358979323846;
enum { PATH_SIZE = 4096 };

/* ---- what is remembered ------------------------------------------------------------------------------------------ */

struct notch { double last_in, earlier_in, last_out, earlier_out; };
struct second_order { double value, rate; };
struct integrator { double first, second; };
struct demand { double pitch[N_BLADES], yaw_rate, torque; };
struct harmonic { double pitch[2], integral[2]; };
#if WITH_LINEAR
/* Offsets of linear optimal pitch as mean, tilt and yaw, and the disturbances that it found; the latest comes first. */
struct linear {
    int fresh;
    double fade, share, slow, age, acted_for; /* age: since the last decision, in intervals */
    double asked[3], acting[3], wanted[3], sum[3];
    double acted[3][N_TAPS], past[N_OUTPUTS][N_DELAYS], lasting[N_OUTPUTS];
#if WITH_AGENT
    double fit_count, fit_past[2][2][N_OUTPUTS], fit_sum[4][N_OUTPUTS], fit[2 * N_OUTPUTS]; /* gains, lags [s] */
    struct integrator velocity[2], position[2]; /* of the tower top, fore-aft and to the side */
    double motion[4];                           /* its velocities [m/s] and displacements [m] */
#endif
};
#endif

#if WITH_FEEDFORWARD
/* Wind ahead: readings of all gates over the travel of the air, the oldest one at `first` of a ring. */
struct ahead {
    int first, count;
    double at[N_SEEN_AHEAD], seen[N_SEEN_AHEAD][N_GATES];
    double traveled, speed, wind, fade, share;
};
#endif

#if WITH_GUARD
/* Supervisor of faults: models of the drives, last readings, and what was found to fail. */
struct guard {
    double share, command[N_BLADES], model[N_BLADES], pitch[N_BLADES], off_for[N_BLADES];
    double moment[N_BLADES], same_for[N_BLADES], shift[N_BLADES], tilt, yaw, vane, wind, vane_same_for;
    int drive[N_BLADES], encoder[N_BLADES], gauge[N_BLADES], shifted[N_BLADES], vane_bad;
};
#endif

#if WITH_SUPERVISOR
/* Supervisory control: what the turbine does, and what this rests on. Speeds are over rated. */
enum { PARKED, START_UP, PRODUCTION, SOFT_CUT_OUT, SHUT_DOWN };
struct supervisor {
    int state, stopped;                          /* stopped: by a fault, for good */
    double mean, gust, rotor, listened, since;   /* wind, over 3 s; speed over 0.5 s; times of the average and the state */
    double set_point, load, asked, ramp;         /* asked: by which an agent moves the set point */
    double pitch, torque, first_speed;           /* demands; speed of the step before in a shut-down */
};
#endif

/* Measured values: the last good one of each reading, and those of the pitched blade that follow. */
struct readings {
    double pitch[N_BLADES], generator_speed, rotor_speed, generator_power, generator_torque, yaw_error, wind_speed;
    double acceleration_fore_aft, acceleration_side_side, azimuth, demanded_power;
    double flap[N_BLADES], edge[N_BLADES];
#if WITH_PLATFORM
    double platform_pitch_rate, platform_roll_rate; /* about the axes of the nacelle */
#endif
#if WITH_LIDAR
    double gate[N_GATES];
#endif
#if WITH_BEAMS
    double beam[N_GATES * N_BEAMS];
#endif
};

struct state {
    int running, provisional;         /* the start rests on readings of the first call */
    long count;                       /* steps of the controller since the start */
    double next_time, step_time;      /* of the next step, and when the last one was due */
    double raw[N_READINGS];           /* last good reading of each record */
    unsigned bad, bad_users, told;    /* readings without meaning, who needs them, and which were said */
    struct readings now;
    /* base controller */
    struct notch notch;
    struct second_order speed;
    double integral, torque_integral, pitch[N_BLADES], torque;
    double wind, smoothed_wind, wind_rotor_speed, shift;
    double read_over, true_speed;     /* set point that speeds are read over, and the rotor speed as it is measured */
#if WITH_EXCLUSION
    struct { double value; int above, crossing; } exclusion;
#endif
#if WITH_SUPERVISOR
    struct supervisor supervisor;
#endif
    /* additions */
    struct harmonic harmonics[2];
    double fade_ipc, fade_fore_aft;
#if WITH_PLATFORM
    double fade_floating;
    struct second_order floating;
#endif
    int fresh_ipc, fresh_fore_aft;
    struct integrator fore_aft, side_side;
#if WITH_LINEAR
    struct linear linear;
#endif
#if WITH_FEEDFORWARD
    struct ahead ahead;
#endif
#if WITH_GUARD
    struct guard guard;
#endif
    double yaw_slow, yaw_fast;
    int turning;
    struct demand present, base, demand; /* present: at the first call */
#if WITH_AGENT
    /* agent */
    double from[N_SETPOINT], to[N_SETPOINT], yaw_rate, action[N_ACT];
#if HAS_SET_POINT
    double set_point; /* offset of that of the supervisor */
#endif
    double fade, share, lasting, mean;
    double anemometer, vane, sensor_wind, sensor_rotor_speed;
    double pitch_now[N_BLADES], pitch_before[N_BLADES], lasting_load[N_CHANNELS];
    double history[N_HISTORY][N_CHANNELS];
#if WITH_LINEAR
    double known[N_OUTPUTS * N_SEEN_BINS + 5 + 3 * N_OUTPUTS + 4]; /* by `linear_known` */
#endif
    long n_history;
    int has_rate;
#endif
    /* drives */
    double command[N_BLADES], angle[N_BLADES], angle_start[N_BLADES], rate_before[N_BLADES], rate[N_BLADES];
    double velocity[N_BLADES], torque_before, torque_now;
};

static struct instance {
    char fingerprint[sizeof FINGERPRINT];
    char parameter_file[PATH_SIZE];
    struct parameters parameters;
    struct state state;
} instance;

/* ---- mathematics ------------------------------------------------------------------------------------------------- */

static double clip(double x, double low, double high) { return x < low ? low : (x > high ? high : x); }

/* The same direction within [-pi, pi). */
static double wrapped(double angle) { return angle - 2.0 * PI * floor(angle / (2.0 * PI) + 0.5); }

static double mean_of(const double *x) {
    double sum = 0.0;
    for (int b = 0; b < N_BLADES; b++) sum += x[b];
    return sum / N_BLADES;
}

/* Rise from 0 at low to 1 at high with continuous slope. */
static double ramp(double value, double low, double high) {
    double x = clip((value - low) / (high - low), 0.0, 1.0);
    return x * x * (3.0 - 2.0 * x);
}

/* Linear between the points of an ascending grid, held beyond its ends. */
static double interpolate(double x, const double *grid, const double *values, int n) {
    int k = 0;
    if (x <= grid[0]) return values[0];
    if (x >= grid[n - 1]) return values[n - 1];
    while (x >= grid[k + 1]) k++;
    return values[k] + (values[k + 1] - values[k]) / (grid[k + 1] - grid[k]) * (x - grid[k]);
}

/* ---- filters, exact for an input held over a step ---------------------------------------------------------------- */

static double low_pass(double value, double input, double dt, double time_constant) {
    double memory = time_constant > 0.0 ? exp(-dt / time_constant) : 0.0;
    return memory * value + (1.0 - memory) * input;
}

static double angle_low_pass(double value, double input, double dt, double time_constant) {
    return wrapped(low_pass(value, value + wrapped(input - value), dt, time_constant));
}

static void notch_reset(struct notch *n, double value) {
    n->last_in = n->earlier_in = n->last_out = n->earlier_out = value;
}

/* (s^2 + w^2)/(s^2 + 2 zeta w s + w^2) by the bilinear transform that is exact at w; w = 0 passes everything. */
static double notch_update(struct notch *n, double value, double dt, double frequency, double damping) {
    double angle = frequency * dt, width, output;
    if (!(angle > 0.0 && angle < PI)) {
        notch_reset(n, value);
        return value;
    }
    width = damping * sin(angle);
    output = value + n->earlier_in - (1.0 - width) * n->earlier_out + 2.0 * cos(angle) * (n->last_out - n->last_in);
    output /= 1.0 + width;
    n->earlier_in = n->last_in;
    n->last_in = value;
    n->earlier_out = n->last_out;
    n->last_out = output;
    return output;
}

/* w^2/(s^2 + 2 zeta w s + w^2). */
static double second_order_update(struct second_order *f, double input, double dt, double w, double zeta) {
    double decay = exp(-zeta * w * dt), c, s; /* cos and sin(q dt)/q, of the damped frequency q or its imaginary part */
    double discriminant = 1.0 - zeta * zeta, q = w * sqrt(fabs(discriminant)), x = f->value - input, v = f->rate;
    if (q * dt < 1e-6) {
        c = 1.0;
        s = dt;
    } else if (discriminant > 0.0) {
        c = cos(q * dt);
        s = sin(q * dt) / q;
    } else {
        c = cosh(q * dt);
        s = sinh(q * dt) / q;
    }
    f->value = input + decay * ((c + zeta * w * s) * x + s * v);
    f->rate = decay * (-w * w * s * x + (c - zeta * w * s) * v);
    return f->value;
}

static void integrator_reset(struct integrator *f, double value, double corner) {
    f->first = value / corner;
    f->second = value / (corner * corner);
}

/* s/(s + w)^2: an integral without its slow part, a velocity from an acceleration. */
static double integrator_update(struct integrator *f, double value, double dt, double w) {
    double e = exp(-w * dt), first = f->first;
    f->first = e * first + (1.0 - e) / w * value;
    f->second = e * f->second + dt * e * first + (1.0 - e - w * dt * e) / (w * w) * value;
    return f->first - w * f->second;
}

/* ---- coordinates of the blades in the frame that does not turn --------------------------------------------------- */

static void to_harmonic(const double *x, double azimuth, int harmonic, double *tilt, double *yaw) {
    double cosine = 0.0, sine = 0.0;
    for (int b = 0; b < N_BLADES; b++) {
        double angle = harmonic * (azimuth + 2.0 * PI * b / N_BLADES);
        cosine += x[b] * cos(angle);
        sine += x[b] * sin(angle);
    }
    *tilt = 2.0 / N_BLADES * cosine;
    *yaw = 2.0 / N_BLADES * sine;
}

static double of_blade(double tilt, double yaw, double azimuth, int harmonic, int blade) {
    double angle = harmonic * (azimuth + 2.0 * PI * blade / N_BLADES);
    return tilt * cos(angle) + yaw * sin(angle);
}

/* ---- how far additions act: not below rated wind ----------------------------------------------------------------- */

static double above_rated(const struct parameters *p, double pitch, double rotor_speed, const double *pitch_ends,
                          const double *speed_ends, const double *fine_speed_ends) {
    double pitched = ramp(pitch - p->fade_fine_pitch, pitch_ends[0], pitch_ends[1]);
    double ratio = rotor_speed / p->rated_rotor_speed;
    return pitched * ramp(ratio, speed_ends[0], speed_ends[1]) +
           (1.0 - pitched) * ramp(ratio, fine_speed_ends[0], fine_speed_ends[1]);
}

/* ---- gain-scheduled proportional-integral law of the collective pitch -------------------------------------------- */

static double gain_factor(const struct parameters *p, double pitch) { return 1.0 / (1.0 + pitch / p->gain_doubling_pitch); }

static double table_gain(const struct parameters *p, const double *gains, double pitch) {
    return interpolate(pitch, p->gain_pitch, gains, N_GAINS);
}

/* Integral with which the law demands the present pitch at a speed error. */
static double law_holding(const struct parameters *p, double pitch, double error) {
    if (GAIN_TABLE) return pitch - table_gain(p, p->proportional_gains, pitch) * error;
    return (pitch / gain_factor(p, pitch) - p->proportional_gain * error) / p->integral_gain;
}

static double law_step(const struct parameters *p, double pitch, double *integral, double error, double dt, double low,
                       double high) {
    double factor, to_integral;
    if (GAIN_TABLE) {
        *integral = clip(*integral + table_gain(p, p->integral_gains, pitch) * error * dt, low, high);
        return clip(table_gain(p, p->proportional_gains, pitch) * error + *integral, low, high);
    }
    factor = gain_factor(p, pitch);
    to_integral = 1.0 / (factor * p->integral_gain);
    *integral = clip(*integral + error * dt, low * to_integral, high * to_integral);
    return clip(factor * (p->proportional_gain * error + p->integral_gain * *integral), low, high);
}

static void speed_reset(struct state *s, double speed) {
    notch_reset(&s->notch, speed);
    s->speed.value = speed;
    s->speed.rate = 0.0;
}

static double speed_update(const struct parameters *p, struct state *s, double dt) {
    double measured = notch_update(&s->notch, s->now.generator_speed, dt, p->notch_frequency, 0.5);
    if (p->filter_damping > 0.0)
        return second_order_update(&s->speed, measured, dt, p->corner_frequency, p->filter_damping);
    return s->speed.value = low_pass(s->speed.value, measured, dt, 1.0 / p->corner_frequency);
}

#if !TRACKS_TIP_SPEED_RATIO
/* ---- base controller with a torque curve ------------------------------------------------------------------------- */

static double torque_curve(const struct parameters *p, double speed, int pitched) {
    double synchronous, slope_15, slope_25, transition, k = p->region_2_gain;
    if (speed <= 0.0) return 0.0;
    if (pitched || speed >= p->rated_generator_speed) return p->rated_power / speed;
    if (speed <= p->cut_in_speed) return 0.0;
    synchronous = p->rated_generator_speed / (1.0 + p->slip);
    slope_15 = k * p->region_2_speed * p->region_2_speed / (p->region_2_speed - p->cut_in_speed);
    slope_25 = p->rated_power / p->rated_generator_speed / (p->rated_generator_speed - synchronous);
    transition = (slope_25 - sqrt(slope_25 * (slope_25 - 4.0 * k * synchronous))) / (2.0 * k);
    if (speed < p->region_2_speed) return slope_15 * (speed - p->cut_in_speed);
    if (speed < transition) return k * speed * speed;
    return slope_25 * (speed - synchronous);
}

#if DERATE
/* ---- no more power than is demanded; without a demand the share `power_level` of rated power --------------------- */

static const double LEAST_SHARE = 0.2, ABOVE_REGION_2 = 1.05;

static double power_share(const struct parameters *p, const struct state *s) {
    double demanded = s->now.demanded_power, share = p->power_level;
    if (demanded > 0.0) share = demanded / p->generator_efficiency / p->rated_power;
    return clip(share, LEAST_SHARE, 1.0);
}

static double derated_speed(const struct parameters *p, double share) {
    if (DERATE == BY_ROTOR_ENERGY) return 1.0 + p->store_raised;
    if (DERATE == BY_SPEED) return fmax(share, fmin(ABOVE_REGION_2 * p->region_2_speed / p->rated_generator_speed, 1.0));
    return 1.0;
}

static double derated_least_pitch(const struct parameters *p, double share) {
    if (DERATE != BY_PITCH) return p->min_pitch;
    return fmax(p->min_pitch, interpolate(share, p->power_shares, p->power_pitch, N_SHARES));
}

static double derated_curve(const struct parameters *p, double speed, double power, double speed_share, int pitched) {
    double rated = speed_share * p->rated_generator_speed, k = p->region_2_gain, synchronous, slope, transition, start, line;
    if (speed <= 0.0) return 0.0;
    if (pitched || speed >= rated) return power / speed;
    if (speed_share == 1.0) return fmin(torque_curve(p, speed, 0), power / speed);
    synchronous = p->rated_generator_speed / (1.0 + p->slip);
    slope = p->rated_power / p->rated_generator_speed / (p->rated_generator_speed - synchronous);
    transition = (slope - sqrt(slope * (slope - 4.0 * k * synchronous))) / (2.0 * k);
    start = rated / (1.0 + p->slip);
    line = power / rated * (speed - start) / (rated - start);
    return fmin(fmax(torque_curve(p, fmin(speed, transition), 0), line), power / speed);
}

static double derated_torque(const struct parameters *p, const struct state *s, double speed, double first) {
    double share = power_share(p, s), power = share * p->rated_power, measured = s->now.generator_speed, torque, held, x;
    int pitched = first >= derated_least_pitch(p, share) + p->region_3_min_pitch - p->min_pitch;
    torque = derated_curve(p, speed, power, fmin(derated_speed(p, share), 1.0), pitched);
    if (p->constant_power == 0.0 && speed > 0.0) torque = fmin(torque, p->rated_power / p->reference_speed);
    torque = fmin(torque, p->max_torque);
    if (DERATE != BY_ROTOR_ENERGY) return torque;
    held = fmin(power / fmax(measured, 1e-3), p->max_torque);
    x = clip((measured / p->reference_speed - p->store_lowest_speed) / p->store_band, 0.0, 1.0);
    return held < torque ? held : torque + x * x * (3.0 - 2.0 * x) * (held - torque);
}
#endif

static void base_start(const struct parameters *p, struct state *s, const struct demand *present) {
    speed_reset(s, s->now.generator_speed);
    memcpy(s->pitch, present->pitch, sizeof s->pitch);
#if DERATE
    s->integral = law_holding(p, s->pitch[0], (1.0 - derated_speed(p, power_share(p, s))) * p->reference_speed);
#else
    s->integral = law_holding(p, s->pitch[0], 0.0);
#endif
    s->torque = present->torque;
}

static void base_step(const struct parameters *p, struct state *s, double dt) {
    double speed = speed_update(p, s, dt), first = s->pitch[0], step = p->max_pitch_rate * dt, pitch, torque;
    double reference = p->reference_speed, least = p->min_pitch, lowest = p->min_pitch;
#if DERATE
    torque = derated_torque(p, s, speed, first);
    reference *= derated_speed(p, power_share(p, s));
    least = derated_least_pitch(p, power_share(p, s));
    lowest = -HUGE_VAL; /* a least pitch that has just risen is reached at the greatest rate */
#else
    const int pitched = first >= p->region_3_min_pitch;
    if (p->constant_power != 0.0) {
        torque = fmin(torque_curve(p, speed, pitched), p->max_torque);
    } else {
        torque = p->rated_power / p->reference_speed;
        if (!pitched && speed < p->rated_generator_speed) torque = fmin(torque_curve(p, speed, 0), torque);
    }
#endif
    if (!isnan(s->torque)) torque = clip(torque, s->torque - p->max_torque_rate * dt, s->torque + p->max_torque_rate * dt);
    s->torque = torque;
    pitch = law_step(p, first, &s->integral, speed - reference, dt, least, p->max_pitch);
    for (int b = 0; b < N_BLADES; b++)
        s->pitch[b] = clip(clip(pitch, s->pitch[b] - step, s->pitch[b] + step), lowest, p->max_pitch);
}
#endif

#if WITH_ESTIMATOR
/* ---- rotor-effective wind from rotor speed, torque and pitch ----------------------------------------------------- */

static int place(const double *grid, int n, double value, double *part) {
    int k = 0;
    while (k < n - 2 && value >= grid[k + 1]) k++;
    *part = clip((value - grid[k]) / (grid[k + 1] - grid[k]), 0.0, 1.0);
    return k;
}

/* Moment of the air about the shaft. */
static double rotor_moment(const struct rotor_table *t, double wind, double rotor_speed, double pitch) {
    double u, v, coefficient;
    int i = place(t->ratio, t->n_ratio, rotor_speed * t->radius / wind, &u), j = place(t->pitch, t->n_pitch, pitch, &v);
    const double *low = t->power + i * t->n_pitch, *high = low + t->n_pitch;
    coefficient = (1 - u) * ((1 - v) * low[j] + v * low[j + 1]) + u * ((1 - v) * high[j] + v * high[j + 1]);
    return 0.5 * t->air_density * PI * t->radius * t->radius * wind * wind * wind * coefficient / rotor_speed;
}

static const double LOWEST_WIND = 2.0, HIGHEST_WIND = 40.0;

static double estimator_start(const struct parameters *p, const struct rotor_table *t, const struct readings *r,
                              double *last_speed) {
    double pitch = mean_of(r->pitch);
    *last_speed = r->rotor_speed;
    if (r->rotor_speed < p->estimator_lowest_speed) return LOWEST_WIND;
    for (int k = 0; k < 153; k++) {
        double wind = LOWEST_WIND + k * (HIGHEST_WIND - LOWEST_WIND) / 152.0;
        if (rotor_moment(t, wind, r->rotor_speed, pitch) >= p->torque_to_moment * r->generator_torque) return wind;
    }
    return LOWEST_WIND;
}

static double estimator_update(const struct parameters *p, const struct rotor_table *t, const struct readings *r,
                               double bandwidth, double dt, double wind, double *last_speed) {
    double speed = r->rotor_speed, before = *last_speed, pitch = mean_of(r->pitch), slope, least, surplus, small = 0.1;
    *last_speed = speed;
    if (fmin(speed, before) < p->estimator_lowest_speed) return wind;
    slope = (rotor_moment(t, wind + small, speed, pitch) - rotor_moment(t, wind - small, speed, pitch)) / (2.0 * small);
    least = 0.1 * t->air_density * PI * t->radius * t->radius * t->radius * t->best_power / t->best_ratio * wind;
    surplus = p->torque_to_moment * r->generator_torque - rotor_moment(t, wind, speed, pitch);
    wind += (p->rotor_inertia * (speed - before) / dt + surplus) / fmax(slope, least) * -expm1(-bandwidth * dt);
    return clip(wind, LOWEST_WIND, HIGHEST_WIND);
}
#endif

#if TRACKS_TIP_SPEED_RATIO
/* ---- base controller that tracks the tip-speed ratio ------------------------------------------------------------- */

static double least_pitch(const struct parameters *p, const struct state *s) {
    return interpolate(s->smoothed_wind, p->schedule_wind, p->schedule_pitch, N_SCHEDULE);
}

static double wanted_shift(const struct parameters *p, const struct state *s, double least) {
    double rated = p->rated_power / p->reference_speed;
    return p->pitch_to_speed * (s->pitch[0] - least) / (p->max_pitch - p->min_pitch) -
           p->torque_to_speed * (rated - s->torque) / rated;
}

#if WITH_EXCLUSION
/* A set point waits at one end of a band of speeds until the requested one has passed the other, then crosses quickly. */
static double outside_band(const struct parameters *p, struct state *s, double requested, double dt) {
    double low = p->exclusion_low, high = p->exclusion_high, step = p->exclusion_rate * dt, *value = &s->exclusion.value;
    int always_above = p->exclusion_above != 0.0, fresh = isnan(*value);
    if (fresh) s->exclusion.above = requested > 0.5 * (low + high);
    if (requested >= high) s->exclusion.above = 1;
    else if (requested <= low) s->exclusion.above = 0;
    if ((low < requested && requested < high) || always_above)
        requested = s->exclusion.above || always_above ? fmax(requested, high) : low;
    if (!fresh && (s->exclusion.crossing || (fmin(*value, requested) < high && fmax(*value, requested) > low))) {
        *value += clip(requested - *value, -step, step);
        s->exclusion.crossing = *value != requested;
    } else {
        *value = requested;
    }
    return *value;
}
#endif

/* Readings for the wind estimate: speeds as they are, whatever the set point; that of rotor and generator by inertia. */
static struct readings of_rotor(const struct parameters *p, const struct state *s) {
    struct readings r = s->now;
#if WITH_SUPERVISOR
    r.rotor_speed = s->true_speed;
    r.generator_speed *= s->read_over;
#endif
    r.rotor_speed += p->generator_share * (r.generator_speed / p->gear_ratio - r.rotor_speed);
    return r;
}

static void speed_errors(const struct parameters *p, struct state *s, double dt, double *of_torque, double *of_pitch) {
    double shift = s->shift * p->reference_speed;
    double tracked = clip(p->speed_per_wind * s->smoothed_wind, p->min_generator_speed, p->reference_speed);
#if WITH_EXCLUSION
    tracked = outside_band(p, s, tracked * s->read_over, dt) / s->read_over;
#else
    (void)dt;
#endif
    *of_torque = s->speed.value - (tracked - fmax(shift, 0.0));
    *of_pitch = s->speed.value - (p->reference_speed - fmin(shift, 0.0));
}

static void base_start(const struct parameters *p, struct state *s, const struct demand *present) {
    double of_torque, of_pitch, rated = p->rated_power / p->reference_speed, speed = s->now.generator_speed;
    double ratio = clip(speed / p->reference_speed, 0.0, 1.0);
    struct readings rotor = of_rotor(p, s);
    speed_reset(s, speed);
    s->smoothed_wind = s->wind = estimator_start(p, &BASE_TABLE, &rotor, &s->wind_rotor_speed);
#if WITH_EXCLUSION
    memset(&s->exclusion, 0, sizeof s->exclusion);
    s->exclusion.value = NAN;
#endif
    for (int b = 0; b < N_BLADES; b++) s->pitch[b] = mean_of(present->pitch);
    s->torque = isnan(present->torque) ? rated * ratio * ratio : present->torque;
    s->shift = wanted_shift(p, s, least_pitch(p, s));
    speed_errors(p, s, 0.0, &of_torque, &of_pitch);
    s->torque_integral = s->torque - p->torque_gain * of_torque;
    s->integral = law_holding(p, s->pitch[0], of_pitch);
}

static void base_step(const struct parameters *p, struct state *s, double dt) {
    double rated = p->rated_power / p->reference_speed, speed = speed_update(p, s, dt), most = rated, least, highest;
    double of_torque, of_pitch, torque, pitch, torque_step = p->max_torque_rate * dt, pitch_step = p->max_pitch_rate * dt;
    struct readings rotor = of_rotor(p, s);
    s->wind = estimator_update(p, &BASE_TABLE, &rotor, p->estimator_bandwidth, dt, s->wind, &s->wind_rotor_speed);
    s->smoothed_wind = low_pass(s->smoothed_wind, s->wind, dt, p->wind_time_constant);
    least = least_pitch(p, s);
    s->shift = low_pass(s->shift, wanted_shift(p, s, least), dt, p->smoothing_time_constant);
    speed_errors(p, s, dt, &of_torque, &of_pitch);
    if (p->constant_power != 0.0) {
        double pitched = p->constant_power_pitch == 0.0 ? 1.0 : (s->pitch[0] - least) / p->constant_power_pitch;
        most = fmin((1.0 + 0.1 * clip(pitched, 0.0, 1.0)) * rated, p->rated_power / fmax(speed, 1e-3));
    }
    highest = fmin(most, p->max_torque);
    s->torque_integral = clip(s->torque_integral + p->torque_integral_gain * of_torque * dt, 0.0, highest);
    torque = clip(p->torque_gain * of_torque + s->torque_integral, 0.0, highest);
    s->torque += clip(torque - s->torque, -torque_step, torque_step);
    pitch = law_step(p, s->pitch[0], &s->integral, of_pitch, dt, least, p->max_pitch);
    pitch = s->pitch[0] + clip(pitch - s->pitch[0], -pitch_step, pitch_step);
    for (int b = 0; b < N_BLADES; b++) s->pitch[b] = pitch;
}
#endif

#if WITH_FEEDFORWARD
/* ---- collective pitch ahead of the wind that a lidar sees -------------------------------------------------------- */

/* Move the present pitch and its integral, and with them the next one, within the limits. */
static void shift_pitch(const struct parameters *p, struct state *s, double change) {
    double before = s->pitch[0], low = p->min_pitch, moved;
#if TRACKS_TIP_SPEED_RATIO
    low = fmin(before, least_pitch(p, s));
#endif
    for (int b = 0; b < N_BLADES; b++) s->pitch[b] = fmin(fmax(s->pitch[b] + change, low), p->max_pitch);
    moved = s->pitch[0] - before;
    if (GAIN_TABLE) s->integral += moved;
    else s->integral = (gain_factor(p, before) * s->integral + moved / p->integral_gain) / gain_factor(p, s->pitch[0]);
}

static void ahead_forget(struct ahead *a) {
    a->first = a->count = 0;
    a->traveled = 0.0;
    a->wind = NAN;
}

static void ahead_start(struct state *s, const struct demand *present) {
    ahead_forget(&s->ahead);
    s->ahead.share = FADE_LIDAR ? 0.0 : 1.0;
    s->ahead.fade = mean_of(present->pitch);
}

static double gates_mean(const double *gates) {
    double sum = 0.0;
    for (int g = 0; g < N_GATES; g++) sum += gates[g];
    return sum / N_GATES;
}

static int ring(const struct ahead *a, int k) { return (a->first + k) % N_SEEN_AHEAD; }

/* Readings that were taken before the air had traveled so far. */
static int ahead_before(const struct ahead *a, double place) {
    int low = 0, high = a->count;
    while (low < high) {
        int middle = (low + high) / 2;
        if (a->at[ring(a, middle)] < place) low = middle + 1;
        else high = middle;
    }
    return low;
}

/* What a gate saw when the air had traveled so far; outside of what is kept the nearest reading. */
static double ahead_read(const struct ahead *a, int gate, double place) {
    int k = ahead_before(a, place), i, j;
    double part;
    if (k == 0) return a->seen[ring(a, 0)][gate];
    if (k == a->count) return a->seen[ring(a, k - 1)][gate];
    i = ring(a, k - 1);
    j = ring(a, k);
    part = (place - a->at[i]) / (a->at[j] - a->at[i]);
    return a->seen[i][gate] + part * (a->seen[j][gate] - a->seen[i][gate]);
}

/* Take a reading of all gates; mean of what they saw of the air that the filter is to get now. */
static double ahead_coming(const struct parameters *p, struct state *s) {
    struct ahead *a = &s->ahead;
    double lag = 1.0 / p->lidar_wavenumber, ahead, sum = 0.0, farthest = 0.0;
    int old;
    if (a->count > 0 && a->traveled - a->at[ring(a, a->count - 1)] > lag) ahead_forget(a); /* too long without */
    if (a->count == 0) a->speed = gates_mean(s->now.gate);
    if (a->count > 0 && a->traveled - a->at[ring(a, a->count - 1)] < LIDAR_SPACING) {
        memcpy(a->seen[ring(a, a->count - 1)], s->now.gate, sizeof s->now.gate); /* in a calm the last one counts */
    } else {
        if (a->count == N_SEEN_AHEAD) {
            a->first = ring(a, 1);
            a->count--;
        }
        a->at[ring(a, a->count)] = a->traveled;
        memcpy(a->seen[ring(a, a->count)], s->now.gate, sizeof s->now.gate);
        a->count++;
    }
    ahead = lag - fmax(a->speed, 0.0) * p->lidar_delay;
    for (int g = 0; g < N_GATES; g++) farthest = fmax(farthest, LIDAR_RANGES[g]);
    old = ahead_before(a, a->traveled - (farthest - ahead)) - 1;
    if (old > 0) {
        a->first = ring(a, old);
        a->count -= old;
    }
    for (int g = 0; g < N_GATES; g++) sum += ahead_read(a, g, a->traveled - (LIDAR_RANGES[g] - ahead));
    return sum / N_GATES;
}

/* Before the base controller: its pitch moves with the wind that is about to arrive, unless the lidar is missing. */
static void ahead_shift(const struct parameters *p, struct state *s, double dt) {
    struct ahead *a = &s->ahead;
    double coming, before, farthest = 0.0, change;
    if (s->bad_users & FOR_LIDAR) return;
    coming = ahead_coming(p, s);
    before = a->wind; /* none after a long time without */
    if (isnan(before)) {
        a->wind = coming;
        return;
    }
    a->wind = coming + exp(-p->lidar_wavenumber * fmax(a->speed, 0.0) * dt) * (before - coming);
    for (int g = 0; g < N_GATES; g++) farthest = fmax(farthest, LIDAR_RANGES[g]);
    if (a->traveled < farthest || a->share <= 0.0) return;
    change = interpolate(a->wind, STEADY_WIND, STEADY_PITCH, N_WINDS) - interpolate(before, STEADY_WIND, STEADY_PITCH, N_WINDS);
    shift_pitch(p, s, p->lidar_gain * a->share * change);
}

/* After the base controller: how far it acts, and the way of the air. */
static void ahead_travel(const struct parameters *p, struct state *s, double dt) {
    struct ahead *a = &s->ahead;
    if (FADE_LIDAR) {
        a->fade = low_pass(a->fade, mean_of(s->pitch), dt, p->lidar_fade_time);
        a->share = above_rated(p, a->fade, s->now.rotor_speed, p->lidar_fade_pitch, p->lidar_fade_speed,
                               p->lidar_fade_fine_speed);
    }
    if (a->count == 0) return;
    a->speed = low_pass(a->speed, gates_mean(a->seen[ring(a, a->count - 1)]), dt, 30.0);
    a->traveled += fmax(a->speed, 0.0) * dt;
}
#endif

/* ---- base controller with what moves it ahead of the wind --------------------------------------------------------- */

static void inner_start(const struct parameters *p, struct state *s, const struct demand *present) {
    base_start(p, s, present);
#if WITH_FEEDFORWARD
    ahead_start(s, present);
#endif
}

static void inner_step(const struct parameters *p, struct state *s, double dt) {
#if WITH_FEEDFORWARD
    ahead_shift(p, s, dt);
#endif
    base_step(p, s, dt);
#if WITH_FEEDFORWARD
    ahead_travel(p, s, dt);
#endif
}

#if WITH_SUPERVISOR
/* ---- supervisory control: stand, start, produce at a set point, stop ---------------------------------------------- */

static const double GUST_TIME = 3.0, SMOOTH_TIME = 0.5, BEST_ANGLE = 0.17453292519943295, STANDS = 0.1,
                    BEYOND_CUT_IN = 1.1, PITCHED = 0.017453292519943295, MOST_TORQUE = 1.1, CALM = 0.5;

static int produces(const struct supervisor *u) { return u->state == PRODUCTION || u->state == SOFT_CUT_OUT; }

/* Rotor speed over rated; that of the generator stands in for a missing one. */
static double relative_speed(const struct parameters *p, const struct state *s) {
    const unsigned rotor = 1u << READ_ROTOR_SPEED, generator = 1u << READ_GENERATOR_SPEED;
    double speed = s->now.rotor_speed;
    if (s->bad & rotor && !(s->bad & generator)) speed = s->now.generator_speed / p->gear_ratio;
    return speed / p->supervisor_rated_speed;
}

/* Set points of speed and power over rated in the mean wind. */
static void set_points(const struct parameters *p, const struct supervisor *u, double *speed, double *power) {
    double width = p->supervisor_cut_out - p->supervisor_derate_from;
    double share = width <= 0.0 ? 0.0 : clip((u->mean - p->supervisor_derate_from) / width, 0.0, 1.0);
    *speed = 1.0 - share * (1.0 - p->supervisor_least_speed);
    *power = 1.0 - share * (1.0 - p->supervisor_least_power);
}

#if WITH_AGENT
/* What of an offset of the set point acts in the present mean wind. */
static double acting_offset(const struct parameters *p, const struct supervisor *u, double asked) {
    double target, power;
    set_points(p, u, &target, &power);
    return fmin(fmax(asked, p->supervisor_cut_in_speed - target), 1.0 - target);
}

/* Share of residual pitch and torque that acts. */
static double agent_share(const struct supervisor *u) { return produces(u) ? u->load : 0.0; }
#endif

/* Start in production, or parked where the rotor barely turns and the blades are feathered. */
static void supervisor_start(const struct parameters *p, struct state *s, const struct demand *present) {
    struct supervisor *u = &s->supervisor;
    double wind = fabs(s->now.wind_speed), speed = relative_speed(p, s), pitch = mean_of(present->pitch);
    int parked = speed < 0.5 * p->supervisor_cut_in_speed && pitch > 0.5 * p->supervisor_feather;
    memset(u, 0, sizeof *u);
    u->state = parked ? PARKED : PRODUCTION;
    u->mean = parked ? wind : clip(wind, p->supervisor_cut_in, p->supervisor_cut_out);
    u->listened = parked ? 0.0 : HUGE_VAL;
    u->gust = wind;
    u->rotor = u->ramp = speed;
    u->set_point = 1.0;
    u->load = parked ? 0.0 : 1.0;
    u->since = parked ? p->supervisor_restart_delay : 0.0;
    u->pitch = pitch;
    u->torque = present->torque;
    u->first_speed = fmax(speed, STANDS);
}

/* Speeds over a set point, a demanded power over what the power is multiplied by in the end. */
static void read_at_set_point(struct state *s, double share, double kept) {
    s->read_over = share;
    s->true_speed = s->now.rotor_speed;
    s->now.rotor_speed /= share;
    s->now.generator_speed /= share;
    s->now.demanded_power /= kept;
}

static void supervisor_enter(struct supervisor *u, int state) {
    u->state = state;
    u->since = 0.0;
}

static void supervisor_move(struct supervisor *u, double pitch, double reach) { u->pitch += clip(pitch - u->pitch, -reach, reach); }

static void begin_production(const struct parameters *p, struct state *s, double speed) {
    struct supervisor *u = &s->supervisor;
    struct readings measured = s->now;
    struct demand present = {{0.0}, 0.0, 0.0};
    supervisor_enter(u, PRODUCTION);
    u->set_point = fmin(speed, 1.0);
    u->load = 0.0;
    for (int b = 0; b < N_BLADES; b++) present.pitch[b] = u->pitch;
    read_at_set_point(s, u->set_point, u->set_point);
    inner_start(p, s, &present);
    s->now = measured;
}

static void produce(const struct parameters *p, struct state *s, struct demand *d, double dt) {
    struct supervisor *u = &s->supervisor;
    struct readings measured = s->now;
    double target, power, reach, cut;
    set_points(p, u, &target, &power);
    u->state = target < 1.0 || power < 1.0 ? SOFT_CUT_OUT : PRODUCTION;
    if (u->asked != 0.0) {
        double moved = fmin(fmax(target + u->asked, p->supervisor_cut_in_speed), 1.0);
        power *= moved / target;
        target = moved;
    }
    reach = dt / (u->pitch > p->supervisor_fine_pitch + PITCHED ? p->supervisor_run_up : 0.1 * p->supervisor_run_up);
    u->set_point += clip(target - u->set_point, -reach, reach);
    u->load = fmin(u->load + 3.0 * dt / p->supervisor_run_up, 1.0);
    cut = fmin(power / target, 1.0);
    read_at_set_point(s, u->set_point, u->set_point * cut);
    inner_step(p, s, dt);
    s->now = measured;
    memcpy(d->pitch, s->pitch, sizeof d->pitch);
    d->torque = u->load * cut * s->torque;
    u->pitch = d->pitch[0];
    u->torque = d->torque;
}

/* Pitch as near to the best angle of attack as the ramp of the speed lets it. */
static void spin_up(const struct parameters *p, struct supervisor *u, double wind, double speed, double dt) {
    double end = BEYOND_CUT_IN * p->supervisor_cut_in_speed, before = u->rotor, proportional, integral, rise, target, inflow, least;
    u->ramp = fmin(u->ramp + dt / p->supervisor_run_up, end);
    u->rotor = low_pass(u->rotor, speed, dt, SMOOTH_TIME);
    if (START_GAIN_TABLE) {
        proportional = interpolate(u->pitch, p->supervisor_gain_pitch, p->supervisor_proportional_gains, N_START_GAINS);
        integral = interpolate(u->pitch, p->supervisor_gain_pitch, p->supervisor_integral_gains, N_START_GAINS);
    } else {
        double factor = 1.0 / (1.0 + u->pitch / p->supervisor_gain_doubling_pitch);
        proportional = factor * p->supervisor_proportional_gain;
        integral = factor * p->supervisor_integral_gain;
    }
    rise = u->rotor - before - (u->ramp < end ? dt / p->supervisor_run_up : 0.0);
    target = u->pitch + p->supervisor_to_generator * (proportional * rise + integral * (u->rotor - u->ramp) * dt);
    inflow = atan2(fmax(wind, 0.0), fmax(speed, 0.0) * p->supervisor_rated_speed * p->supervisor_radius);
    least = fmin(fmax(inflow - BEST_ANGLE, p->supervisor_fine_pitch), p->supervisor_feather);
    supervisor_move(u, fmin(fmax(target, least), p->supervisor_feather), p->supervisor_start_rate * dt);
    u->torque = 0.0;
}

/* Blades to feather, torque with the square of the speed. */
static void shut_down(const struct parameters *p, struct supervisor *u, double speed, double dt) {
    double ratio = fmin(fmax(speed, 0.0) / u->first_speed, 1.0);
    supervisor_move(u, p->supervisor_feather, p->supervisor_stop_rate * dt);
    u->first_speed = fmax(speed, STANDS);
    u->torque = speed < p->supervisor_cut_in_speed ? 0.0 : u->torque * ratio * ratio;
}

static void supervisor_step(const struct parameters *p, struct state *s, struct demand *d, double dt) {
    struct supervisor *u = &s->supervisor;
    double wind = fabs(s->now.wind_speed), speed = relative_speed(p, s), averaging = 0.5 * p->supervisor_averaging;
    if (u->listened >= averaging) {
        u->mean = low_pass(u->mean, wind, dt, averaging);
    } else { /* after a parked start the plain mean for the time of the filter */
        u->listened += dt;
        u->mean += (wind - u->mean) * dt / u->listened;
    }
    u->gust = low_pass(u->gust, wind, dt, GUST_TIME);
    u->since += dt;
    if (u->state == PARKED) {
        int waited = u->since >= p->supervisor_restart_delay && u->listened >= averaging && !u->stopped;
        if (waited && u->mean >= p->supervisor_cut_in && u->mean <= p->supervisor_restart && u->gust < p->supervisor_gust) {
            supervisor_enter(u, START_UP);
            u->ramp = fmax(speed, 0.0);
            u->rotor = speed;
        }
    } else if (u->state == SHUT_DOWN) {
        if (speed < STANDS && u->pitch >= p->supervisor_feather - PITCHED) supervisor_enter(u, PARKED);
    } else if (u->stopped || u->mean > p->supervisor_cut_out || u->mean < p->supervisor_cut_in - CALM ||
               u->gust > p->supervisor_gust || speed > p->supervisor_overspeed) {
        u->torque = fmin(u->torque, MOST_TORQUE * p->supervisor_rated_torque);
        u->first_speed = fmax(speed, STANDS);
        supervisor_enter(u, SHUT_DOWN);
    } else if (u->state == START_UP && speed >= p->supervisor_cut_in_speed) {
        begin_production(p, s, speed);
    }
    if (produces(u)) {
        produce(p, s, d, dt);
        return;
    }
    if (u->state == START_UP) {
        spin_up(p, u, wind, speed, dt);
    } else if (u->state == SHUT_DOWN) {
        shut_down(p, u, speed, dt);
    } else {
        supervisor_move(u, p->supervisor_feather, p->supervisor_stop_rate * dt);
        u->torque = 0.0;
    }
    for (int b = 0; b < N_BLADES; b++) d->pitch[b] = u->pitch;
    d->torque = u->torque;
}

/* What numbers of a parameter file must be beside each other; returns 0, or -1 with a message. */
static int supervisor_checked(const struct parameters *p, const char *path, char *message, size_t size) {
    int winds = p->supervisor_cut_in < p->supervisor_restart && p->supervisor_restart <= p->supervisor_cut_out;
    if (winds && p->supervisor_least_power <= p->supervisor_least_speed) return 0;
    snprintf(message, size, "%.600s: %s", path,
             winds ? "supervisor_least_power must be at most supervisor_least_speed"
                   : "must be supervisor_cut_in < supervisor_restart <= supervisor_cut_out");
    return -1;
}
#endif

/* ---- additions --------------------------------------------------------------------------------------------------- */

static void shorten(double *vector, double size) {
    double length = hypot(vector[0], vector[1]);
    if (length > size) {
        vector[0] *= size / length;
        vector[1] *= size / length;
    }
}

/* Tilt and yaw pitch against the moment of one harmonic, or its part beyond a band; limits end the integral too. */
static void harmonic_step(const struct parameters *p, struct harmonic *h, const double *moments, double azimuth, double dt,
                          double share, int k) {
    double moment[2], wanted[2], move[2], size, beyond, kept, integrated, proportional;
    to_harmonic(moments, azimuth, k + 1, &moment[0], &moment[1]);
    size = hypot(moment[0], moment[1]);
    beyond = size > p->ipc_level[k] ? 1.0 - p->ipc_level[k] / size : 0.0;
    kept = size < p->ipc_level[k] ? exp(-p->ipc_leak[k] * dt) : 1.0;
    integrated = share * p->ipc_integral_gain[k] * dt * beyond;
    proportional = share * p->ipc_proportional_gain[k] * beyond;
    for (int i = 0; i < 2; i++) wanted[i] = kept * h->integral[i] + (integrated + proportional) * moment[i];
    shorten(wanted, share * p->ipc_limit[k]);
    for (int i = 0; i < 2; i++) move[i] = wanted[i] - h->pitch[i];
    shorten(move, p->ipc_rate_limit[k] * dt);
    for (int i = 0; i < 2; i++) {
        h->pitch[i] += move[i];
        h->integral[i] = h->pitch[i] - proportional * moment[i];
    }
}

static void individual_pitch(const struct parameters *p, struct state *s, struct demand *d, double dt) {
    double share = 1.0, azimuth = s->now.azimuth, lead = s->now.rotor_speed * p->ipc_lead;
    if (FADE_IPC) {
        if (s->fresh_ipc) s->fade_ipc = mean_of(d->pitch);
        s->fade_ipc = low_pass(s->fade_ipc, mean_of(d->pitch), dt, p->ipc_fade_time);
        share = above_rated(p, s->fade_ipc, s->now.rotor_speed, p->ipc_fade_pitch, p->ipc_fade_speed,
                            p->ipc_fade_fine_speed);
    }
    s->fresh_ipc = 0;
    if (s->bad_users & FOR_IPC) share = 0.0;
    for (int k = 0; k < N_HARMONICS; k++) {
        harmonic_step(p, &s->harmonics[k], s->now.flap, azimuth, dt, share, k);
        for (int b = 0; b < N_BLADES; b++)
            d->pitch[b] += of_blade(s->harmonics[k].pitch[0], s->harmonics[k].pitch[1], azimuth + lead, k + 1, b);
    }
    for (int b = 0; b < N_BLADES; b++) d->pitch[b] = clip(d->pitch[b], p->drive_min_pitch, p->drive_max_pitch);
}

/* The same pitch for all blades; none is taken below the least pitch, but one stays there that the controller put there. */
static void add_pitch(const struct parameters *p, struct demand *d, double added, double least) {
    for (int b = 0; b < N_BLADES; b++) {
        double angle = d->pitch[b];
        d->pitch[b] = fmin(fmax(angle + added, fmin(angle, least)), p->drive_max_pitch);
    }
}

#if WITH_PLATFORM
/* Collective pitch in proportion to the velocity of the hub by the pitch of the platform; none while that is unknown. */
static void floating_feedback(const struct parameters *p, struct state *s, struct demand *d, double dt) {
    double rate = p->floating_height * s->now.platform_pitch_rate, share = 1.0;
    double velocity = second_order_update(&s->floating, rate, dt, p->floating_corner_frequency, 1.0);
    if (FADE_FLOATING) {
        s->fade_floating = low_pass(s->fade_floating, mean_of(d->pitch), dt, p->floating_fade_time);
        share = above_rated(p, s->fade_floating, s->now.rotor_speed, p->floating_fade_pitch, p->floating_fade_speed,
                            p->floating_fade_fine_speed);
    }
    if (s->bad_users & FOR_FLOATING) share = 0.0;
    add_pitch(p, d, share * clip(p->floating_gain * velocity, -p->floating_limit, p->floating_limit), p->floating_min_pitch);
}
#endif

/* Collective pitch in proportion to the fore-aft velocity of the nacelle. */
static void fore_aft_damper(const struct parameters *p, struct state *s, struct demand *d, double dt) {
    double velocity = integrator_update(&s->fore_aft, s->now.acceleration_fore_aft, dt, p->fore_aft_corner), share = 1.0;
    if (FADE_FORE_AFT) {
        if (s->fresh_fore_aft) s->fade_fore_aft = mean_of(d->pitch);
        s->fade_fore_aft = low_pass(s->fade_fore_aft, mean_of(d->pitch), dt, p->fore_aft_fade_time);
        share = above_rated(p, s->fade_fore_aft, s->now.rotor_speed, p->fore_aft_fade_pitch, p->fore_aft_fade_speed,
                            p->fore_aft_fade_fine_speed);
    }
    s->fresh_fore_aft = 0;
    add_pitch(p, d, share * clip(p->fore_aft_gain * velocity, -p->fore_aft_limit, p->fore_aft_limit), p->fore_aft_min_pitch);
}

/* Generator torque in proportion to the side-side velocity of the nacelle. */
static void side_side_damper(const struct parameters *p, struct state *s, struct demand *d, double dt) {
    double velocity = integrator_update(&s->side_side, s->now.acceleration_side_side, dt, p->side_side_corner);
    double limit = fmin(p->side_side_limit, 0.5 * d->torque);
    double added = fmin(fmax(p->side_side_gain * velocity, -limit), limit);
    d->torque = fmin(d->torque + added, fmax(p->drive_max_torque, d->torque));
}

#if WITH_LINEAR
/* ---- linear optimal pitch: mean, tilt and yaw from the disturbances that the model of the turbine leaves ------------ */

static void shift(double *rows, int n_rows, int n, int steps) {
    if (steps <= 0 || steps >= n) return;
    for (int i = 0; i < n_rows; i++) memmove(rows + i * n + steps, rows + i * n, (size_t)(n - steps) * sizeof *rows);
}

/* Four sums side by side: one alone waits for every addition. */
static double product(const float *weights, const double *values, int n) {
    double sum[4] = {0.0, 0.0, 0.0, 0.0};
    int k = 0;
    for (; k + 4 <= n; k += 4)
        for (int i = 0; i < 4; i++) sum[i] += (double)weights[k + i] * values[k + i];
    for (; k < n; k++) sum[0] += (double)weights[k] * values[k];
    return sum[0] + sum[1] + (sum[2] + sum[3]);
}

/* Mean, tilt and yaw of values of the blades at an azimuth. */
static void to_fixed_frame(const double *x, double azimuth, double *out) {
    out[0] = mean_of(x);
    to_harmonic(x, azimuth, 1, &out[1], &out[2]);
}

/* Place of a slow pitch among the designs: that below, and the share of the one above. */
static int design_below(double pitch, double *share) {
    int k = 0;
    *share = 0.0;
    if (N_DESIGNS == 1 || pitch <= LINEAR_PITCH[0]) return 0;
    while (k < N_DESIGNS - 2 && pitch > LINEAR_PITCH[k + 1]) k++;
    *share = fmin((pitch - LINEAR_PITCH[k]) / (LINEAR_PITCH[k + 1] - LINEAR_PITCH[k]), 1.0);
    return k;
}

static void linear_start(struct linear *l, const struct readings *r) {
    memset(l, 0, sizeof *l);
    l->fresh = 1;
    l->share = 1.0;
#if WITH_AGENT
    integrator_reset(&l->velocity[0], r->acceleration_fore_aft, LINEAR_CORNER[0]);
    integrator_reset(&l->velocity[1], LINEAR_SIDE * r->acceleration_side_side, LINEAR_CORNER[1]);
#else
    (void)r;
#endif
}

/* The mean of the offsets since the last decision, for each of the intervals that passed. */
static void linear_remember(struct linear *l, int passed) {
    if (passed <= 0) return;
    shift(&l->acted[0][0], 3, N_TAPS, passed);
    for (int j = 0; j < 3; j++) {
        for (int k = 0; k < passed && k < N_TAPS; k++) l->acted[j][k] = l->sum[j] / l->acted_for;
        l->sum[j] = 0.0;
    }
    l->acted_for = 0.0;
}

/* Disturbances, which are what is measured less what the offsets did, and the former, over their scale. */
static void linear_find(const struct readings *r, const struct linear *l, double *found, double *measured) {
    double share;
    int low = design_below(l->slow, &share);
    to_fixed_frame(r->flap, r->azimuth, measured);
    measured[3] = r->acceleration_fore_aft;
    measured[4] = LINEAR_SIDE * r->acceleration_side_side;
    measured[5] = r->rotor_speed;
#if WITH_PLATFORM
    if (N_OUTPUTS > 6) {
        measured[N_OUTPUTS - 2] = r->platform_pitch_rate;
        measured[N_OUTPUTS - 1] = LINEAR_SIDE * r->platform_roll_rate;
    }
#endif
    for (int i = 0; i < N_OUTPUTS; i++) {
        const float *of_low = &LINEAR_RESPONSES[(low * N_OUTPUTS + i) * 3 * N_TAPS];
        measured[i] /= LINEAR_SCALE[i];
        found[i] = measured[i] - (1.0 - share) * product(of_low, &l->acted[0][0], 3 * N_TAPS);
        if (share > 0.0) found[i] -= share * product(of_low + N_OUTPUTS * 3 * N_TAPS, &l->acted[0][0], 3 * N_TAPS);
    }
}

#if WITH_AGENT
/* What is left of the own effect in the disturbances: regression of their changes on those of what the model explains and
 * of its rate, with a window of 30 s. */
static void linear_fit(struct linear *l, const double *found, const double *measured, int passed) {
    const double kept = exp(-LINEAR_INTERVAL / 30.0), least = 1e-4;
    if (passed != 1) l->fit_count = 0.0;
    for (int i = 0; i < N_OUTPUTS; i++) {
        double explained = measured[i] - found[i];
        if (l->fit_count > 1.5) {
            double change = 0.5 * (found[i] - l->fit_past[0][1][i]), along = 0.5 * (explained - l->fit_past[1][1][i]);
            double rate = (explained - 2.0 * l->fit_past[1][0][i] + l->fit_past[1][1][i]) / LINEAR_INTERVAL;
            const double now[4] = {change * along, along * along, change * rate, rate * rate};
            for (int k = 0; k < 4; k++) l->fit_sum[k][i] += (1.0 - kept) * (now[k] - l->fit_sum[k][i]);
            l->fit[i] = l->fit_sum[0][i] / (l->fit_sum[1][i] + least);
            l->fit[N_OUTPUTS + i] = -l->fit_sum[2][i] / (l->fit_sum[3][i] + least);
        }
        for (int which = 0; which < 2; which++) l->fit_past[which][1][i] = l->fit_past[which][0][i];
        l->fit_past[0][0][i] = found[i];
        l->fit_past[1][0][i] = explained;
    }
    l->fit_count += 1.0;
}

/* Motion of the tower top without its slow part, from the accelerations of the nacelle. */
static void linear_move(struct linear *l, const struct readings *r, double dt) {
    const double acceleration[2] = {r->acceleration_fore_aft, LINEAR_SIDE * r->acceleration_side_side};
    for (int k = 0; k < 2; k++) {
        l->motion[k] = integrator_update(&l->velocity[k], acceleration[k], dt, LINEAR_CORNER[k]);
        l->motion[2 + k] = integrator_update(&l->position[k], l->motion[k], dt, LINEAR_CORNER[k]);
    }
}
#endif

/* Take the disturbances of now into the past, without what lasts. */
static void linear_take(struct linear *l, const double *found, int passed) {
    if (!l->fresh) shift(&l->past[0][0], N_OUTPUTS, N_DELAYS, passed);
    for (int i = 0; i < N_OUTPUTS; i++) {
        double *past = l->past[i], tau = LINEAR_WASHOUT[i], held = past[0];
        if (l->fresh) {
            l->lasting[i] = found[i];
            for (int k = 0; k < N_DELAYS; k++) past[k] = tau > 0.0 ? 0.0 : found[i];
        } else { /* nothing was measured between */
            for (int k = 1; k < passed && k < N_DELAYS; k++) past[k] = held;
        }
        l->lasting[i] += (tau > 0.0 ? 1.0 - exp(-passed * LINEAR_INTERVAL / tau) : passed > 0) * (found[i] - l->lasting[i]);
        past[0] = tau > 0.0 ? found[i] - l->lasting[i] : found[i];
    }
}

/* Offsets that the past of the disturbances asks for. */
static void linear_answer(const struct parameters *p, const struct linear *l, double *wanted) {
    double share;
    int low = design_below(l->slow, &share);
    for (int j = 0; j < 3; j++) {
        const float *of_low = &LINEAR_GAINS[(low * 3 + j) * N_OUTPUTS * N_DELAYS];
        wanted[j] = (1.0 - share) * product(of_low, &l->past[0][0], N_OUTPUTS * N_DELAYS);
        if (share > 0.0) wanted[j] += share * product(of_low + 3 * N_OUTPUTS * N_DELAYS, &l->past[0][0], N_OUTPUTS * N_DELAYS);
        wanted[j] *= p->linear_gain;
    }
}

static void linear_pitch(const struct parameters *p, struct state *s, struct demand *d, double dt) {
    struct linear *l = &s->linear;
    double ahead = s->now.azimuth + s->now.rotor_speed * p->linear_lead, reach = p->linear_rate_limit * dt;
    double slow = mean_of(d->pitch) + l->acting[0], wanted[3], move[2], reached[N_BLADES], found[N_OUTPUTS];
    double measured[N_OUTPUTS];
    int passed = (int)(l->age + 1e-6);
    if (FADE_LINEAR) {
        if (l->fresh) l->fade = mean_of(d->pitch);
        l->fade = low_pass(l->fade, mean_of(d->pitch), dt, p->linear_fade_time);
        l->share = above_rated(p, l->fade, s->now.rotor_speed, p->linear_fade_pitch, p->linear_fade_speed,
                               p->linear_fade_fine_speed);
    }
    if (s->bad_users & FOR_LINEAR) l->share = 0.0;
    l->slow = low_pass(l->fresh ? slow : l->slow, slow, dt, p->linear_schedule_time);
#if WITH_AGENT
    linear_move(l, &s->now, dt);
#endif
    if (l->fresh || passed > 0) {
        linear_remember(l, passed);
        linear_find(&s->now, l, found, measured);
#if WITH_AGENT
        linear_fit(l, found, measured, passed);
#endif
        linear_take(l, found, passed);
        linear_answer(p, l, l->wanted);
        l->age -= passed;
        l->fresh = 0;
    }
    for (int j = 0; j < 3; j++) wanted[j] = l->share * l->wanted[j];
    wanted[0] = clip(wanted[0], -p->linear_limit, p->linear_limit);
    shorten(&wanted[1], p->linear_limit);
    l->asked[0] += clip(wanted[0] - l->asked[0], -reach, reach);
    for (int j = 0; j < 2; j++) move[j] = wanted[1 + j] - l->asked[1 + j];
    shorten(move, reach);
    for (int j = 0; j < 2; j++) l->asked[1 + j] += move[j];
    for (int b = 0; b < N_BLADES; b++) {
        double before = d->pitch[b], angle = before + l->asked[0] + of_blade(l->asked[1], l->asked[2], ahead, 1, b);
        d->pitch[b] = clip(angle, fmin(before, p->drive_min_pitch), fmax(before, p->drive_max_pitch));
        reached[b] = d->pitch[b] - before;
    }
    to_fixed_frame(reached, ahead, l->acting);
    l->age += dt / LINEAR_INTERVAL;
    l->acted_for += dt;
    for (int j = 0; j < 3; j++) l->sum[j] += dt * l->acting[j];
}

#if WITH_AGENT || WITH_GUARD
/* What was added to a demand behind it, taken for an offset of its own: so the disturbances stay what no offset changes. */
static void linear_sees(const struct parameters *p, struct state *s, const double *base, const double *demand, double dt) {
    double added[N_BLADES], turned[3];
    for (int b = 0; b < N_BLADES; b++) added[b] = demand[b] - base[b];
    to_fixed_frame(added, s->now.azimuth + s->now.rotor_speed * p->linear_lead, turned);
    for (int j = 0; j < 3; j++) s->linear.sum[j] += dt * turned[j];
}
#endif

#if WITH_AGENT
/* What is known of the disturbances at an instant, before it acts: output by output the mean over the first of the bins of
 * delays, then the change from each bin to the one before it; mean, tilt and yaw that they ask for, share, slow pitch, fit
 * of the model, response to the offsets, motion of the tower top. */
static void linear_known(const struct parameters *p, const struct state *s, const struct readings *r, double *known) {
    struct linear l = s->linear;
    double found[N_OUTPUTS], measured[N_OUTPUTS];
    int passed = (int)(l.age + 1e-6);
    if (l.fresh) l.slow = mean_of(r->pitch);
    linear_remember(&l, passed);
    linear_find(r, &l, found, measured);
    if (l.fresh || passed > 0) linear_take(&l, found, passed);
    for (int i = 0; i < N_OUTPUTS; i++) {
        double before = 0.0;
        for (int k = 0; k < N_SEEN_BINS; k++) {
            double sum = 0.0, mean;
            for (int delay = SEEN_BINS[k]; delay < SEEN_BINS[k + 1]; delay++) sum += l.past[i][delay];
            mean = sum / (SEEN_BINS[k + 1] - SEEN_BINS[k]);
            *known++ = k == 0 ? mean : before - mean;
            before = mean;
        }
    }
    linear_answer(p, &l, known);
    known[3] = l.share;
    known[4] = l.slow;
    memcpy(known + 5, l.fit, sizeof l.fit);
    for (int i = 0; i < N_OUTPUTS; i++) known[5 + 2 * N_OUTPUTS + i] = measured[i] - found[i];
    memcpy(known + 5 + 3 * N_OUTPUTS, l.motion, sizeof l.motion);
}
#endif
#endif

/* The nacelle turns only when it has stood wrong for a while, then until it faces the wind. */
static void yaw_by_dead_band(const struct parameters *p, struct state *s, struct demand *d, double dt) {
    s->yaw_slow = angle_low_pass(s->yaw_slow, s->now.yaw_error, dt, p->yaw_slow_time);
    s->yaw_fast = angle_low_pass(s->yaw_fast, s->now.yaw_error, dt, p->yaw_fast_time);
    if (s->turning == 0 && fabs(s->yaw_slow) > p->yaw_dead_band) {
        s->turning = s->yaw_slow > 0.0 ? 1 : -1;
    } else if (s->turning != 0 && s->turning * s->yaw_fast <= p->yaw_stop && fabs(s->yaw_fast) < 0.5 * PI) {
        s->turning = 0;
        s->yaw_slow = wrapped(s->yaw_fast);
    }
    if (s->bad_users & FOR_YAW) s->turning = 0;
    d->yaw_rate = s->turning * p->yaw_rate;
}

#if WITH_GUARD
/* ---- supervisor of faults: repaired readings before the controller, collective pitch behind it ------------------- */

static void guard_start(struct state *s, const struct demand *present) {
    struct guard *g = &s->guard;
    memset(g, 0, sizeof *g);
    g->share = 1.0;
    memcpy(g->command, present->pitch, sizeof g->command);
    memcpy(g->model, present->pitch, sizeof g->model);
    memcpy(g->pitch, s->now.pitch, sizeof g->pitch);
    memcpy(g->moment, s->now.flap, sizeof g->moment);
    g->vane = s->now.yaw_error;
    g->wind = NAN;
}

/* What the sensors show of drives, gauges and vane in a step. */
static void guard_watch(const struct parameters *p, struct state *s, double dt) {
    struct guard *g = &s->guard;
    const struct readings *r = &s->now;
    const double reach = p->drive_pitch_rate * dt, rounding = 1e-9;
    for (int b = 0; b < N_BLADES; b++) {
        double change = r->flap[b] - g->moment[b], jump = fabs(r->pitch[b] - g->pitch[b]);
        int off;
        g->same_for[b] = change == 0.0 ? g->same_for[b] + dt : 0.0;
        if (fabs(change) > p->guard_moment_jump) {
            g->shift[b] += change;
            g->shifted[b] = 1;
        }
        if (g->same_for[b] > p->guard_frozen_time - rounding) g->gauge[b] = 1;
        g->moment[b] = r->flap[b];
        if (jump > 1.5 * reach + 0.5 * p->guard_pitch_tolerance) g->encoder[b] = 1;
        g->pitch[b] = r->pitch[b];
        off = fabs(r->pitch[b] - g->model[b]) > p->guard_pitch_tolerance && !g->encoder[b];
        g->off_for[b] = off ? g->off_for[b] + dt : 0.0;
        if (off && g->off_for[b] > p->guard_pitch_time - rounding) g->drive[b] = 1;
    }
    if (r->yaw_error != g->vane) g->vane_same_for = 0.0;
    else if (r->wind_speed != g->wind) g->vane_same_for += dt;
    g->wind = r->wind_speed;
    if (g->vane_same_for > p->guard_frozen_time - rounding) g->vane_bad = 1;
    if (fabs(wrapped(r->yaw_error - g->vane)) > p->guard_vane_jump) g->vane_bad = 1;
    g->vane = r->yaw_error;
}

/* Put what can be believed in the place of readings; tilt and yaw of the moments move over a time. */
static void guard_believe(const struct parameters *p, struct guard *g, struct readings *r, double dt) {
    double speeds[3] = {r->rotor_speed, r->generator_speed / p->gear_ratio, 0.0}, best, mean = 0.0;
    double cosine[N_BLADES], sine[N_BLADES], tilt = 0.0, yaw = 0.0;
    int good = 0;
    best = fmax(speeds[0], speeds[1]);
    if (r->generator_torque > p->guard_least_torque) {
        speeds[2] = r->generator_power / (p->guard_efficiency * r->generator_torque * p->gear_ratio);
        best = fmax(fmin(speeds[0], speeds[1]), fmin(best, speeds[2]));
    }
    if (fabs(speeds[0] - best) > p->guard_speed_tolerance) r->rotor_speed = best;
    if (fabs(speeds[1] - best) > p->guard_speed_tolerance) r->generator_speed = best * p->gear_ratio;
    for (int b = 0; b < N_BLADES; b++) {
        cosine[b] = cos(r->azimuth + 2.0 * PI * b / N_BLADES);
        sine[b] = sin(r->azimuth + 2.0 * PI * b / N_BLADES);
        if (g->gauge[b]) continue;
        mean += r->flap[b] - g->shift[b] - g->tilt * cosine[b] - g->yaw * sine[b];
        good++;
    }
    if (good > 0) mean /= good;
    for (int b = 0; b < N_BLADES; b++) {
        double error = r->flap[b] - g->shift[b] - mean - g->tilt * cosine[b] - g->yaw * sine[b];
        if (g->gauge[b]) continue;
        tilt += error * cosine[b];
        yaw += error * sine[b];
    }
    g->tilt += dt / 1.5 * tilt;
    g->yaw += dt / 1.5 * yaw;
    for (int b = 0; b < N_BLADES; b++) {
        if (g->gauge[b]) r->flap[b] = mean + g->tilt * cosine[b] + g->yaw * sine[b];
        else if (g->shifted[b]) r->flap[b] -= g->shift[b];
        if (g->encoder[b]) r->pitch[b] = g->model[b];
    }
    if (g->vane_bad) r->yaw_error = 0.0;
}

/* Watch the readings, and put what can be believed in their place. */
static void guard_read(const struct parameters *p, struct state *s, double dt) {
    struct guard *g = &s->guard;
    struct readings *r = &s->now;
    double reach, lag;
    reach = p->drive_pitch_rate * dt;
    lag = p->drive_servo_frequency > 0.0 ? 2.0 * p->drive_servo_damping / p->drive_servo_frequency : 0.0;
    for (int b = 0; b < N_BLADES; b++) {
        double target = clip(s->demand.pitch[b], p->drive_min_pitch, p->drive_max_pitch);
        g->command[b] += clip(target - g->command[b], -reach, reach);
        g->model[b] = low_pass(g->model[b], g->command[b], dt, lag);
    }
    if (!(s->bad_users & FOR_GUARD)) {
        guard_watch(p, s, dt);
#if WITH_SUPERVISOR
        for (int b = 0; b < N_BLADES; b++)
            if (g->drive[b] && fabs(r->pitch[b] - g->model[b]) > p->guard_stop_deviation) s->supervisor.stopped = 1;
#endif
    }
    guard_believe(p, g, r, dt);
}

/* With a drive that fails, or gauges of less than two blades, all blades go over to the mean of the demands. */
static void guard_act(const struct parameters *p, struct state *s, struct demand *d, double dt) {
    struct guard *g = &s->guard;
    double goal = 1.0, reach = dt / p->guard_fade_time, mean = mean_of(d->pitch);
    int gauges = 0;
    for (int b = 0; b < N_BLADES; b++) {
        if (g->drive[b]) goal = 0.0;
        gauges += !g->gauge[b];
    }
    if (gauges < 2) goal = 0.0;
    g->share += clip(goal - g->share, -reach, reach);
    if (g->vane_bad) d->yaw_rate = 0.0;
    if (g->share < 1.0) {
        double before[N_BLADES];
        memcpy(before, d->pitch, sizeof before);
        for (int b = 0; b < N_BLADES; b++) d->pitch[b] = mean + g->share * (before[b] - mean);
#if WITH_LINEAR
        linear_sees(p, s, before, d->pitch, dt);
#endif
    }
}
#endif

static void additions_start(const struct parameters *p, struct state *s) {
    memset(s->harmonics, 0, sizeof s->harmonics);
    s->fresh_ipc = s->fresh_fore_aft = 1;
#if WITH_PLATFORM
    s->floating = (struct second_order){0.0, 0.0};
    s->fade_floating = mean_of(s->present.pitch);
#endif
#if WITH_LINEAR
    linear_start(&s->linear, &s->now);
#endif
    integrator_reset(&s->fore_aft, s->now.acceleration_fore_aft, p->fore_aft_corner);
    integrator_reset(&s->side_side, s->now.acceleration_side_side, p->side_side_corner);
    s->yaw_slow = wrapped(clip(s->now.yaw_error, -p->yaw_dead_band, p->yaw_dead_band));
    s->yaw_fast = wrapped(s->now.yaw_error);
    s->turning = 0;
}

static void controller_step(const struct parameters *p, struct state *s, double dt) {
    struct demand *d = &s->base;
#if WITH_GUARD
    struct readings measured = s->now; /* what an agent sees */
    guard_read(p, s, dt);
#endif
#if WITH_SUPERVISOR
    supervisor_step(p, s, d, dt);
#else
    inner_step(p, s, dt);
    memcpy(d->pitch, s->pitch, sizeof d->pitch);
    d->torque = s->torque;
#endif
    d->yaw_rate = 0.0;
    for (int k = 0; k < N_ADDITIONS; k++) {
        switch (ADDITIONS[k]) {
        case INDIVIDUAL_PITCH: individual_pitch(p, s, d, dt); break;
#if WITH_LINEAR
        case LINEAR_PITCH_ADDED: linear_pitch(p, s, d, dt); break;
#endif
        case FORE_AFT_DAMPER: fore_aft_damper(p, s, d, dt); break;
#if WITH_PLATFORM
        case FLOATING_FEEDBACK: floating_feedback(p, s, d, dt); break;
#endif
        case SIDE_SIDE_DAMPER: side_side_damper(p, s, d, dt); break;
        case YAW: yaw_by_dead_band(p, s, d, dt); break;
        default: break;
        }
    }
#if WITH_GUARD
    guard_act(p, s, d, dt);
    s->now = measured;
#endif
}

#if WITH_AGENT
/* ---- agent: offsets on the demands of the controller ------------------------------------------------------------- */

static double fixed_frame(const double *x, double azimuth, int part) {
    double tilt, yaw;
    if (part == 0) return mean_of(x);
    to_harmonic(x, azimuth, 1, &tilt, &yaw);
    return part == 1 ? tilt : yaw;
}

/* Moments of the blades that do not pitch, from those of the pitched ones. */
static void out_of_plane(const struct readings *r, double *moment) {
    for (int b = 0; b < N_BLADES; b++) moment[b] = r->flap[b] * cos(r->pitch[b]) - r->edge[b] * sin(r->pitch[b]);
}

static double demanded_power(const struct parameters *p, const struct state *s) {
    double demanded = s->now.demanded_power;
    return demanded > 0.0 ? demanded : p->power_level * p->rated_power * p->generator_efficiency;
}

static double observed(const struct parameters *p, const struct state *s, const struct channel *c, double dt) {
    const struct readings *r = &s->now;
    const double *now = s->pitch_now, *before = s->pitch_before;
    double moment[N_BLADES];
    int i = c->index;
    switch (c->kind) {
    case SEE_OUT_OF_PLANE_MOMENT: out_of_plane(r, moment); return moment[i];
    case SEE_OUT_OF_PLANE_FIXED_FRAME: out_of_plane(r, moment); return fixed_frame(moment, r->azimuth, i);
    case SEE_ROTOR_SPEED: return r->rotor_speed;
    case SEE_GENERATOR_SPEED: return r->generator_speed;
    case SEE_GENERATOR_POWER: return r->generator_power;
    case SEE_GENERATOR_TORQUE: return r->generator_torque;
    case SEE_ACCELERATION_FORE_AFT: return r->acceleration_fore_aft;
    case SEE_ACCELERATION_SIDE_SIDE: return r->acceleration_side_side;
    case SEE_PITCH: return now[i];
    case SEE_MEAN_PITCH: return mean_of(now);
    case SEE_PITCH_RATE: return s->has_rate ? (now[i] - before[i]) / dt : 0.0;
    case SEE_MEAN_PITCH_RATE: return s->has_rate ? (mean_of(now) - mean_of(before)) / dt : 0.0;
    case SEE_PITCH_DEMAND: return s->demand.pitch[i];
    case SEE_MEAN_PITCH_DEMAND: return mean_of(s->demand.pitch);
    case SEE_TORQUE_DEMAND: return s->demand.torque;
    case SEE_FLAP_MOMENT: return r->flap[i];
    case SEE_EDGE_MOMENT: return r->edge[i];
    case SEE_FLAP_FIXED_FRAME: return fixed_frame(r->flap, r->azimuth, i);
    case SEE_EDGE_FIXED_FRAME: return fixed_frame(r->edge, r->azimuth, i);
    case SEE_WIND_SPEED: return s->anemometer;
    case SEE_YAW_ERROR: return s->vane;
    case SEE_ROTOR_WIND: return s->sensor_wind;
    case SEE_AZIMUTH_SIN: return sin(r->azimuth);
    case SEE_AZIMUTH_COS: return cos(r->azimuth);
    case SEE_CONTROLLER_PITCH: return mean_of(s->base.pitch);
    case SEE_CONTROLLER_TORQUE: return s->base.torque;
    case SEE_SETPOINT: return s->to[i];
    case SEE_SHARE: return s->share;
    case SEE_MEAN_OFFSET: return s->mean;
    case SEE_DEAD_BAND_ERROR: return s->yaw_slow;
    case SEE_DEAD_BAND_TURNING: return s->turning;
    case SEE_PREVIOUS_ACTION: return s->action[i];
#if WITH_LIDAR
    case SEE_LIDAR: return r->gate[i];
#endif
#if WITH_BEAMS
    case SEE_LIDAR_BEAM: return r->beam[i];
#endif
#if WITH_SUPERVISOR
    case SEE_SUPERVISOR_STATE: return s->supervisor.state == i;
    case SEE_SUPERVISOR_WIND: return s->supervisor.mean;
    case SEE_SUPERVISOR_SET_POINT: return s->supervisor.set_point;
    case SEE_SUPERVISOR_LOAD: return s->supervisor.load;
#endif
#if HAS_SET_POINT
    case SEE_SET_POINT_OFFSET: return s->set_point;
#endif
    case SEE_DEMANDED_POWER: return demanded_power(p, s);
    case SEE_POWER_ERROR: return r->generator_power - demanded_power(p, s);
    case SEE_ROTOR_ENERGY: return 0.5 * p->rotor_inertia * r->rotor_speed * r->rotor_speed;
    case SEE_POWER_HEADROOM:
        return fmin(p->headroom_factor * pow(s->sensor_wind, 3.0), p->headroom_most) - demanded_power(p, s);
#if WITH_DIAL
    case SEE_DIAL: return log2(N_DIAL * p->dial[i] / (p->dial[0] + p->dial[1] + p->dial[2]));
#endif
#if WITH_LINEAR
    case SEE_DISTURBANCE: return s->known[i / MOST_SEEN_BINS * N_SEEN_BINS + i % MOST_SEEN_BINS];
    case SEE_LINEAR_PITCH: return s->known[N_OUTPUTS * N_SEEN_BINS + i];
    case SEE_MODEL_GAIN: return s->known[N_OUTPUTS * N_SEEN_BINS + 5 + i];
    case SEE_MODEL_LAG: return s->known[N_OUTPUTS * N_SEEN_BINS + 5 + N_OUTPUTS + i];
    case SEE_OWN_RESPONSE: return s->known[N_OUTPUTS * N_SEEN_BINS + 5 + 2 * N_OUTPUTS + i];
    case SEE_TOWER_MOTION: return s->known[N_OUTPUTS * N_SEEN_BINS + 5 + 3 * N_OUTPUTS + i];
#endif
#if WITH_PLATFORM
    case SEE_PLATFORM: return s->raw[READ_PLATFORM + i];
#endif
    default: return c->offset; /* not on the interface: held where the policy sees zero */
    }
}

/* What the washout of a channel starts from: of a blade the mean of the blades, of an acceleration zero. */
static double lasting_at_start(const struct state *s, const struct channel *c, double value) {
    const struct readings *r = &s->now;
    double moment[N_BLADES];
    switch (c->kind) {
    case SEE_FLAP_MOMENT: return mean_of(r->flap);
    case SEE_EDGE_MOMENT: return mean_of(r->edge);
    case SEE_OUT_OF_PLANE_MOMENT: out_of_plane(r, moment); return mean_of(moment);
    case SEE_ACCELERATION_FORE_AFT:
    case SEE_ACCELERATION_SIDE_SIDE: return 0.0;
    default: return value;
    }
}

/* A reading of all channels; of loads what does not last. */
static void observe(const struct parameters *p, struct state *s, double *row) {
    for (int k = 0; k < N_CHANNELS; k++) {
        const struct channel *c = &CHANNELS[k];
        double *lasting = &s->lasting_load[k];
        row[k] = observed(p, s, c, p->control_step);
        if (!c->washed || p->sensor_washout <= 0.0 || c->kind == SEE_HELD) continue;
        *lasting = s->n_history == 0 ? lasting_at_start(s, c, row[k])
                                     : low_pass(*lasting, row[k], p->control_step, p->sensor_washout);
        row[k] -= *lasting;
    }
}

static void policy(const struct state *s, double *action) {
    float a[WIDTH], b[WIDTH], *x = a, *y = b, *swapped;
    for (int k = 0; k < N_OBS; k++) {
        long late = s->n_history - 1 - DELAY - k / N_CHANNELS;
        const struct channel *c = &CHANNELS[k % N_CHANNELS];
        double value = s->history[(late > 0 ? late : 0) % N_HISTORY][k % N_CHANNELS];
        x[k] = (float)((clip(value, c->low, c->high) - c->offset) / c->scale);
    }
    if (NORMALIZED)
        for (int k = 0; k < N_OBS; k++)
            x[k] = (float)clip((x[k] - NORMAL_MEAN[k]) / NORMAL_DEVIATION[k], -NORMAL_LIMIT, NORMAL_LIMIT);
    for (int l = 0; l < N_LAYERS; l++) {
        const struct layer *layer = &LAYERS[l];
        for (int i = 0; i < layer->n_out; i++) {
            const float *w = layer->weight + (size_t)i * layer->n_in;
            float sum = layer->bias[i];
            for (int j = 0; j < layer->n_in; j++) sum += w[j] * x[j];
            switch (layer->activation) {
            case TANH: sum = tanhf(sum); break;
            case RELU: sum = sum > 0.0f ? sum : 0.0f; break;
            case ELU: sum = sum > 0.0f ? sum : expm1f(sum); break;
            default: break;
            }
            y[i] = sum;
        }
        swapped = x;
        x = y;
        y = swapped;
    }
    for (int k = 0; k < N_ACT; k++)
        action[k] = clip(SQUASHED ? tanhf(x[k]) : x[k], -1.0, 1.0);
}

/* Greatest move of a coordinate of the setpoint in a control step, and its limit. */
static double setpoint_move(const struct parameters *p, int k) {
    return (k < N_PITCH ? p->offset_pitch_rate : p->offset_torque_rate) * p->control_step;
}
static double setpoint_limit(const struct parameters *p, int k) {
    return k < N_PITCH ? p->offset_pitch_limit[k] : p->offset_torque_limit;
}

/* Whether the offsets return to zero: a reading is missing, or the agent is switched off. */
static int rests(const struct parameters *p, const struct state *s) {
    return (s->bad_users & FOR_AGENT) != 0 || p->agent == 0.0;
}

/* Component of the action that belongs to a coordinate of the setpoint: pitch comes first, then yaw, torque, set point. */
static int action_of(int k) { return k < N_PITCH ? k : N_ACT - 1 - HAS_SET_POINT; }

#if WITH_SUPERVISOR
/* Offset of the supervisor's set point; what does not act is not kept, since it would have to come back first. */
static void agent_ask(const struct parameters *p, struct state *s, const double *action) {
    double asked = 0.0;
    s->supervisor.asked = 0.0;
    if (p->agent == 0.0) return;
#if HAS_SET_POINT
    double limit = p->offset_set_point_limit, reach = p->offset_set_point_rate * p->control_step, chosen = action[N_ACT - 1];
    if (OFFSET_FORM) asked = s->set_point + clip(chosen * limit - s->set_point, -reach, reach);
    else asked = clip(s->set_point + chosen * reach, -limit, limit);
    s->set_point = asked = acting_offset(p, &s->supervisor, asked);
#else
    (void)action;
    asked = acting_offset(p, &s->supervisor, asked);
#endif
    s->supervisor.asked = asked;
}
#endif

static void agent_start(const struct parameters *p, struct state *s) {
    double pitch = mean_of(s->demand.pitch);
    memset(s->from, 0, sizeof s->from);
    memset(s->to, 0, sizeof s->to);
    memset(s->action, 0, sizeof s->action);
    s->yaw_rate = s->lasting = s->mean = 0.0;
#if HAS_SET_POINT
    s->set_point = 0.0;
#endif
    s->fade = pitch;
    s->share = 1.0;
    if (FADE_AGENT) s->share = above_rated(p, pitch, s->now.rotor_speed, p->offset_fade_pitch, p->offset_fade_speed,
                                        p->offset_fade_fine_speed);
    s->anemometer = s->now.wind_speed;
    s->vane = wrapped(s->now.yaw_error);
    memcpy(s->pitch_now, s->now.pitch, sizeof s->pitch_now);
    memcpy(s->pitch_before, s->now.pitch, sizeof s->pitch_before);
    s->n_history = 0;
    s->has_rate = 0;
#if SENSES_WIND
    s->sensor_wind = estimator_start(p, &SENSOR_TABLE, &s->now, &s->sensor_rotor_speed);
#endif
}

/* What the sensors remember, from one control step to the next. */
static void sensors_advance(const struct parameters *p, struct state *s) {
    double dt = p->control_step;
    s->anemometer = low_pass(s->anemometer, s->now.wind_speed, dt, p->anemometer_time);
    s->vane = angle_low_pass(s->vane, s->now.yaw_error, dt, p->vane_time);
    memcpy(s->pitch_before, s->pitch_now, sizeof s->pitch_now);
    memcpy(s->pitch_now, s->now.pitch, sizeof s->pitch_now);
    s->has_rate = 1;
#if SENSES_WIND
    s->sensor_wind = estimator_update(p, &SENSOR_TABLE, &s->now, p->sensor_bandwidth, dt, s->sensor_wind,
                                      &s->sensor_rotor_speed);
#endif
}

/* A new setpoint, once a control step. */
static void agent_act(const struct parameters *p, struct state *s) {
    double action[N_ACT], *row = s->history[s->n_history % N_HISTORY];
    if (s->count > 0) sensors_advance(p, s);
#if WITH_LINEAR
    struct readings believed = s->now;
#if WITH_GUARD
    struct guard known = s->guard; /* nothing is remembered */
    guard_believe(p, &known, &believed, 0.0);
#endif
    linear_known(p, s, &believed, s->known);
#endif
    observe(p, s, row);
    s->n_history++;
    policy(s, action);
    if (rests(p, s)) { /* at the greatest rate */
        memset(action, 0, sizeof action);
        for (int k = 0; k < N_COORDINATES; k++)
            action[action_of(k)] = OFFSET_FORM ? 0.0 : clip(-s->to[k] / setpoint_move(p, k), -1.0, 1.0);
#if HAS_SET_POINT
        if (!OFFSET_FORM) action[N_ACT - 1] = clip(-s->set_point / (p->offset_set_point_rate * p->control_step), -1.0, 1.0);
#endif
    }
    memcpy(s->action, action, sizeof action);
    memcpy(s->from, s->to, sizeof s->from);
    for (int k = 0; k < N_COORDINATES; k++) {
        double limit = setpoint_limit(p, k), reach = setpoint_move(p, k), move = action[action_of(k)] * reach;
        if (OFFSET_FORM) move = clip(action[action_of(k)] * limit - s->to[k], -reach, reach);
        s->to[k] = clip(s->to[k] + move, -limit, limit);
    }
    s->yaw_rate = HAS_YAW ? action[N_PITCH] * p->offset_yaw_rate : 0.0;
#if WITH_SUPERVISOR
    agent_ask(p, s, action);
#endif
}

/* Demand of the controller and the offsets that act, a part of the way from one setpoint to the next. */
static void agent_add(const struct parameters *p, struct state *s, double part, double dt) {
    double offset[N_SETPOINT] = {0.0}, azimuth, torque = s->base.torque, bound = 1.0;
#if WITH_GUARD
    struct readings measured = s->now;
    struct guard known = s->guard; /* nothing is remembered */
    guard_believe(p, &known, &s->now, 0.0);
#endif
    azimuth = s->now.azimuth + s->now.rotor_speed * p->offset_lead;
#if WITH_SUPERVISOR
    bound = agent_share(&s->supervisor);
#endif
    for (int k = 0; k < N_COORDINATES; k++) offset[k] = s->from[k] + part * (s->to[k] - s->from[k]);
    if (N_PITCH > 0 && FADE_AGENT) {
        s->fade = low_pass(s->fade, mean_of(s->base.pitch), dt, p->offset_fade_time);
        s->share = above_rated(p, s->fade, s->now.rotor_speed, p->offset_fade_pitch, p->offset_fade_speed,
                                        p->offset_fade_fine_speed);
    }
    if (N_PITCH > 0 && N_MEAN > 0 && p->offset_washout > 0.0) {
        double mean = 0.0, count = N_MEAN;
        for (int k = 0; k < N_MEAN; k++) mean += offset[k] / count;
        if (rests(p, s)) s->lasting -= clip(s->lasting, -p->offset_pitch_rate * dt, p->offset_pitch_rate * dt);
        else s->lasting = low_pass(s->lasting, mean, dt, p->offset_washout);
        s->mean = bound * s->share * (mean - s->lasting);
        for (int k = 0; k < N_MEAN; k++) offset[k] -= s->lasting;
    }
    for (int b = 0; b < N_BLADES; b++) {
        double added = 0.0;
        switch (PITCH_FORM) {
        case COLLECTIVE: added = offset[0]; break;
        case INDIVIDUAL: added = offset[b % N_SETPOINT]; break;
        case FIXED_FRAME: added = offset[0] + of_blade(offset[1 % N_SETPOINT], offset[2 % N_SETPOINT], azimuth, 1, b); break;
        case CYCLIC: added = of_blade(offset[0], offset[1 % N_SETPOINT], azimuth, 1, b); break;
        default: break;
        }
        s->demand.pitch[b] = clip(s->base.pitch[b] + bound * s->share * added, p->drive_min_pitch, p->drive_max_pitch);
    }
#if WITH_GUARD
    if (s->guard.share < 1.0) { /* of its individual pitch acts what the supervisor of faults leaves */
        double mean = mean_of(s->demand.pitch) - mean_of(s->base.pitch);
        for (int b = 0; b < N_BLADES; b++) {
            double added = s->demand.pitch[b] - s->base.pitch[b];
            s->demand.pitch[b] = s->base.pitch[b] + mean + s->guard.share * (added - mean);
        }
    }
#endif
    if (HAS_TORQUE) {
        double speed = s->now.rotor_speed;
        torque += bound * offset[N_SETPOINT - 1];
        if (speed > 0.0) torque = fmin(torque, fmax(s->base.torque, p->most_shaft_power / speed));
    }
#if WITH_LINEAR
    linear_sees(p, s, s->base.pitch, s->demand.pitch, dt);
#endif
    s->demand.torque = clip(torque, 0.0, p->drive_max_torque);
    s->demand.yaw_rate = clip(s->yaw_rate + s->base.yaw_rate, -p->drive_yaw_rate, p->drive_yaw_rate);
#if WITH_GUARD
    s->now = measured;
#endif
}
#endif

/* ---- drives, for codes without: the command moves at no more than the greatest rate ------------------------------ */

static void drives_start(struct state *s) {
    for (int b = 0; b < N_BLADES; b++) {
        s->command[b] = s->angle[b] = s->angle_start[b] = s->now.pitch[b];
        s->rate[b] = s->rate_before[b] = s->velocity[b] = 0.0;
    }
    s->torque_before = s->torque_now = s->demand.torque;
}

/* At a step of the controller: the way to the new demand. */
static void drives_take(const struct parameters *p, struct state *s) {
    double dt = p->controller_step, move = p->drive_torque_rate * dt;
    for (int b = 0; b < N_BLADES; b++) {
        double turn = p->drive_pitch_rate * dt;
        turn = clip(clip(s->demand.pitch[b], p->drive_min_pitch, p->drive_max_pitch) - s->command[b], -turn, turn);
        /* where the last step ends, whether or not a call came at its end */
        s->angle_start[b] += 0.5 * (s->rate_before[b] + s->rate[b]) * dt;
        s->rate_before[b] = s->rate[b];
        s->rate[b] = turn / dt;
        s->command[b] += turn;
    }
    s->torque_before = s->torque_now;
    s->torque_now += clip(s->demand.torque - s->torque_now, -move, move);
}

/* At every call: angles and torque at its time, `tau` after the step of the controller. Codes apply what a call gives at
 * the time of the call: ahead by one of OpenFAST's steps of 0.0125 s, loads differ by up to 0.5 %. */
static void drives_move(const struct parameters *p, struct state *s, double tau, double dt, struct demand *out) {
    double step = p->controller_step;
    *out = s->demand;
    tau = clip(tau, 0.0, step);
    for (int b = 0; b < N_BLADES; b++) {
        if (p->drive_servo_frequency > 0.0) {
            struct second_order servo = {s->angle[b], s->velocity[b]};
            double command = s->command[b] - s->rate[b] * (step - tau);
            s->angle[b] = second_order_update(&servo, command, dt, p->drive_servo_frequency, p->drive_servo_damping);
            s->velocity[b] = servo.rate;
        } else {
            s->angle[b] = s->angle_start[b] + s->rate_before[b] * tau +
                          (s->rate[b] - s->rate_before[b]) * tau * tau / (2.0 * step);
        }
        out->pitch[b] = s->angle[b];
    }
    out->torque = s->torque_before + (s->torque_now - s->torque_before) * tau / step;
}

/* ---- readings ---------------------------------------------------------------------------------------------------- */

/* Readings to be told of: those that somebody needs, and the speed that would have stood in for a missing one. */
static unsigned missed(const struct state *s) {
    unsigned needed = s->bad & (1u << READ_GENERATOR_SPEED) ? 1u << READ_ROTOR_SPEED : 0u;
    for (int k = 0; k < N_READINGS; k++)
        if (READINGS[k].users != 0) needed |= 1u << k;
    return s->bad & needed;
}

/* Tower-top acceleration along the axes of the nacelle. Where it comes along those of the tower top (OpenFAST: YawBrTAxp and
 * YawBrTAyp), the angle of the nacelle turns it; with one of the three missing, the last acceleration is held. */
static void take_acceleration(const struct parameters *p, struct state *s) {
    struct readings *r = &s->now;
    const double x = s->raw[READ_FORE_AFT], y = s->raw[READ_SIDE_SIDE], yaw = s->raw[READ_NACELLE_YAW];
    const unsigned needed = 1u << READ_FORE_AFT | 1u << READ_SIDE_SIDE | 1u << READ_NACELLE_YAW;
    if (p->acceleration_axes != 0.0) {
        r->acceleration_fore_aft = x;
        r->acceleration_side_side = y;
    } else if (!(s->bad & needed)) {
        r->acceleration_fore_aft = cos(yaw) * x + sin(yaw) * y;
        r->acceleration_side_side = cos(yaw) * y - sin(yaw) * x;
    }
}

#if WITH_LIDAR
static const double LIDAR_TOLERANCE = 0.2; /* of a distance ahead of the tower axis, in ranges of the gate */

#if WITH_BEAMS
/* Number of the beam that a point in a gate belongs to, -1 of none: the nearest one, within half of the way to the next. */
static int beam_of(double left, double up, double range) {
    double least = BEAM_TOLERANCE * range;
    int beam = -1;
    for (int b = 0; b < N_BEAMS; b++) {
        double away = hypot(left - BEAM_LEFT[b] * range, up - BEAM_UP[b] * range);
        if (away <= least) {
            least = away;
            beam = b;
        }
    }
    return beam;
}
#endif

/* Each point belongs to the gate whose range is nearest to its distance ahead of the tower axis; means over the points of the
 * gates, and of each beam where they are read apart. Returns whether every gate, or beam, has points, and each of them a speed. */
static int read_lidar(const struct parameters *p, struct state *s, const float *swap) {
    const float *of_lidar = swap + LIDAR_SENSOR - 1, *points = swap + LIDAR_SPEEDS - 1;
    double sum[N_GATES] = {0.0}, yaw = s->raw[READ_NACELLE_YAW];
    int found[N_GATES] = {0}, n;
#if WITH_BEAMS
    double beam_sum[N_GATES * N_BEAMS] = {0.0};
    int beam_found[N_GATES * N_BEAMS] = {0};
#endif
    if (!(swap[128] >= LIDAR_SPEEDS)) return 0; /* the array ends before */
    if (!(of_lidar[1] >= 1.0f && of_lidar[2] >= 1.0f && of_lidar[1] * of_lidar[2] <= MOST_LIDAR_POINTS)) return 0;
    n = (int)lround(of_lidar[1]) * (int)lround(of_lidar[2]);
    if (!(swap[128] >= LIDAR_SPEEDS - 1 + 4 * n)) return 0;
    for (int k = 0; k < n; k++) {
        double distance = -(cos(yaw) * points[n + k] + sin(yaw) * points[2 * n + k]), speed = points[k];
        int gate = 0;
        for (int g = 1; g < N_GATES; g++)
            if (fabs(distance - LIDAR_RANGES[g]) < fabs(distance - LIDAR_RANGES[gate])) gate = g;
        if (!isfinite(distance)) return 0;
        if (fabs(distance - LIDAR_RANGES[gate]) > LIDAR_TOLERANCE * LIDAR_RANGES[gate]) continue; /* a gate of others */
        if (!(speed >= READINGS[READ_LIDAR].low && speed <= READINGS[READ_LIDAR].high)) return 0;
        sum[gate] += speed;
        found[gate]++;
#if WITH_BEAMS
        {
            double left = cos(yaw) * points[2 * n + k] - sin(yaw) * points[n + k];
            int beam = beam_of(left, points[3 * n + k] - HUB_HEIGHT, LIDAR_RANGES[gate]);
            if (beam < 0) continue;
            beam_sum[gate * N_BEAMS + beam] += speed;
            beam_found[gate * N_BEAMS + beam]++;
        }
#endif
    }
#if WITH_BEAMS
    for (int k = 0; k < N_GATES * N_BEAMS; k++)
        if (beam_found[k] == 0) return 0;
#endif
    for (int g = 0; g < N_GATES; g++)
        if (found[g] == 0) return 0;
    for (int g = 0; g < N_GATES; g++) s->now.gate[g] = p->lidar_speed_factor * sum[g] / found[g];
#if WITH_BEAMS
    for (int k = 0; k < N_GATES * N_BEAMS; k++) s->now.beam[k] = p->lidar_speed_factor * beam_sum[k] / beam_found[k];
#endif
    return 1;
}
#endif

/* Take the readings: one that is no number or out of range keeps its last good value and rests who needs it. */
static void read_swap(const struct parameters *p, struct state *s, const float *swap, double elapsed) {
    struct readings *r = &s->now;
    const double *raw = s->raw;
    s->bad = s->bad_users = 0;
    for (int k = 0; k < N_READINGS - WITH_LIDAR; k++) {
        const struct reading *from = &READINGS[k];
        double value = from->record > 129 && !(swap[128] >= from->record) ? NAN : swap[from->record - 1];
        if (k == READ_NACELLE_YAW && p->acceleration_axes != 0.0 && !WITH_LIDAR && !WITH_PLATFORM) continue; /* not needed */
        if (k == READ_NACELLE_YAW && WITH_PLATFORM) value -= swap[128] >= 1006.0f ? swap[1005] : NAN; /* turns it, too */
        if (value >= from->low && value <= from->high) { /* false for what is no number */
            s->raw[k] = value;
        } else {
            s->bad |= 1u << k;
            s->bad_users |= from->users;
        }
    }
#if WITH_LIDAR
    if (!read_lidar(p, s, swap)) {
        s->bad |= 1u << READ_LIDAR;
        s->bad_users |= READINGS[READ_LIDAR].users;
    }
#endif
    if (s->bad & (1u << READ_AZIMUTH)) s->raw[READ_AZIMUTH] = wrapped(raw[READ_AZIMUTH] + raw[READ_ROTOR_SPEED] * elapsed);
    if (s->bad & (1u << READ_GENERATOR_SPEED) && !(s->bad & (1u << READ_ROTOR_SPEED)))
        s->raw[READ_GENERATOR_SPEED] = raw[READ_ROTOR_SPEED] * p->gear_ratio;
    r->generator_speed = raw[READ_GENERATOR_SPEED];
    r->rotor_speed = raw[READ_ROTOR_SPEED];
    r->generator_power = raw[READ_POWER];
    r->generator_torque = raw[READ_TORQUE];
    r->yaw_error = raw[READ_YAW_ERROR];
    r->wind_speed = raw[READ_WIND];
    r->demanded_power = raw[READ_DEMANDED_POWER];
    take_acceleration(p, s);
#if WITH_PLATFORM
    if (!(s->bad & (1u << READ_NACELLE_YAW | 3u << (READ_PLATFORM + 4)))) {
        const double c = cos(raw[READ_NACELLE_YAW]), d = sin(raw[READ_NACELLE_YAW]);
        const double roll = raw[READ_PLATFORM + 4], pitch = raw[READ_PLATFORM + 5];
        r->platform_pitch_rate = c * pitch - d * roll;
        r->platform_roll_rate = c * roll + d * pitch;
    }
#endif
    r->azimuth = raw[READ_AZIMUTH];
    for (int b = 0; b < N_BLADES; b++) {
        /* the records hold moments of the blade that does not pitch; those of the pitched blade follow */
        double angle = raw[READ_PITCH + b], out = raw[READ_OUT_OF_PLANE + b], in = raw[READ_IN_PLANE + b];
        r->pitch[b] = angle;
        r->flap[b] = out * cos(angle) + in * sin(angle);
        r->edge[b] = in * cos(angle) - out * sin(angle);
    }
}

/* ---- numbers as text: strtod follows the locale of the caller, which may have a decimal comma ---------------------- */

enum { DIGITS = 40, GREATEST_EXPONENT = 400, LIMBS = 64 }; /* 10^(40 + 400) < 2^1462; shifted by as much at most: < 2^2048 */
struct whole { unsigned long limb[LIMBS]; int n; };        /* a whole number in base 2^32, the lowest limb first */

static void whole_multiply(struct whole *x, unsigned long factor, unsigned long added) {
    for (int k = 0; k < x->n; k++) {
        unsigned long long product = (unsigned long long)x->limb[k] * factor + added;
        x->limb[k] = (unsigned long)(product & 0xffffffffUL);
        added = (unsigned long)(product >> 32);
    }
    if (added != 0) x->limb[x->n++] = added;
}

static int whole_compare(const struct whole *x, const struct whole *y) {
    if (x->n != y->n) return x->n < y->n ? -1 : 1;
    for (int k = x->n - 1; k >= 0; k--)
        if (x->limb[k] != y->limb[k]) return x->limb[k] < y->limb[k] ? -1 : 1;
    return 0;
}

static void whole_subtract(struct whole *x, const struct whole *y) {
    unsigned long borrow = 0;
    for (int k = 0; k < x->n; k++) {
        unsigned long taken = (k < y->n ? y->limb[k] : 0) + borrow;
        borrow = x->limb[k] < taken;
        x->limb[k] = (x->limb[k] + (borrow ? 0xffffffffUL - taken + 1UL : 0UL - taken)) & 0xffffffffUL;
    }
    while (x->n > 0 && x->limb[x->n - 1] == 0) x->n--;
}

/* The double nearest to numerator/denominator, ties to even, by binary long division. */
static double quotient(struct whole *numerator, struct whole *denominator) {
    double value = 0.0;
    int exponent = 0, bits = 53, above;
    while (whole_compare(numerator, denominator) < 0) {
        whole_multiply(numerator, 2, 0);
        exponent--;
    }
    for (;;) { /* until 1 <= quotient < 2 */
        struct whole twice = *denominator;
        whole_multiply(&twice, 2, 0);
        if (whole_compare(numerator, &twice) < 0) break;
        *denominator = twice;
        exponent++;
    }
    if (exponent < -1022) bits -= -1022 - exponent; /* subnormal numbers have fewer */
    if (bits < 0) return 0.0;
    for (int k = 0; k < bits; k++) {
        int one = whole_compare(numerator, denominator) >= 0;
        value = 2.0 * value + one;
        if (one) whole_subtract(numerator, denominator);
        whole_multiply(numerator, 2, 0);
    }
    above = whole_compare(numerator, denominator); /* of the rest to half of the last bit */
    if (above > 0 || (above == 0 && fmod(value, 2.0) != 0.0)) value += 1.0;
    return ldexp(value, exponent - bits + 1);
}

/* A decimal number, with a point in every locale, or inf; *end is `at` where there is none. */
static double read_number(const char *at, const char **end) {
    struct whole numerator = {{0}, 0}, denominator = {{1}, 1};
    int digits = 0, any = 0, point = 0, negative;
    long exponent = 0;
    double value;
    const char *from = at;
    *end = at;
    from += strspn(from, " \t");
    negative = *from == '-';
    if (*from == '-' || *from == '+') from++;
    if (strncmp(from, "inf", 3) == 0) {
        *end = from + 3;
        return negative ? -HUGE_VAL : HUGE_VAL;
    }
    for (;; from++) {
        if (*from == '.' && !point) {
            point = 1;
        } else if (*from >= '0' && *from <= '9') {
            any = 1;
            if (digits < DIGITS) {
                whole_multiply(&numerator, 10, (unsigned long)(*from - '0'));
                digits += numerator.n > 0; /* zeros before the first one do not count */
                exponent -= point;
            } else {
                exponent += !point;
            }
        } else {
            break;
        }
    }
    if (!any) return 0.0;
    *end = from;
    if (*from == 'e' || *from == 'E') {
        long power = 0;
        int down = from[1] == '-';
        from += from[1] == '-' || from[1] == '+' ? 2 : 1;
        if (*from >= '0' && *from <= '9') {
            for (; *from >= '0' && *from <= '9'; from++)
                if (power < 100000) power = 10 * power + (*from - '0');
            exponent += down ? -power : power;
            *end = from;
        }
    }
    if (numerator.n == 0 || exponent < -GREATEST_EXPONENT) {
        value = 0.0;
    } else if (exponent > GREATEST_EXPONENT) {
        value = HUGE_VAL;
    } else {
        for (long k = 0; k < exponent; k++) whole_multiply(&numerator, 10, 0);
        for (long k = 0; k > exponent; k--) whole_multiply(&denominator, 10, 0);
        value = quotient(&numerator, &denominator);
    }
    return negative ? -value : value;
}

/* ---- parameter file, checkpoints --------------------------------------------------------------------------------- */

/* Read `name = numbers  # comment` lines; returns 0, or -1 with a message. */
static int read_parameters(struct parameters *p, const char *path, char *message, size_t size) {
    char line[4096];
    FILE *file = fopen(path, "r");
    if (file == NULL) {
        snprintf(message, size, "the parameter file %.600s must be readable", path);
        return -1;
    }
    for (int number = 1; fgets(line, sizeof line, file) != NULL; number++) {
        char name[64];
        const char *at, *end;
        const struct entry *entry = NULL;
        double *value;
        line[strcspn(line, "#!\r\n")] = '\0';
        at = line + strspn(line, " \t");
        if (*at == '\0') continue;
        if (sscanf(at, "%63[A-Za-z0-9_]", name) != 1 || (at = strchr(at, '=')) == NULL) {
            snprintf(message, size, "%.600s, line %d: must be 'name = value'", path, number);
            fclose(file);
            return -1;
        }
        for (size_t k = 0; k < N_ENTRIES; k++)
            if (strcmp(ENTRIES[k].name, name) == 0) entry = &ENTRIES[k];
        if (entry == NULL) {
            snprintf(message, size, "%.600s, line %d: there is no parameter '%s'", path, number, name);
            fclose(file);
            return -1;
        }
        value = (double *)(void *)((char *)p + entry->offset);
        at++;
        for (int k = 0; k < entry->count; k++, at = end) {
            value[k] = read_number(at, &end);
            if (end == at || !(value[k] >= entry->low && value[k] <= entry->high)) {
                snprintf(message, size, "%.600s, line %d: %s must be %d number(s) from %g to %g", path, number, name,
                         entry->count, entry->low, entry->high);
                fclose(file);
                return -1;
            }
        }
        if (at[strspn(at, " \t")] != '\0') {
            snprintf(message, size, "%.600s, line %d: %s must be %d number(s), there are more", path, number, name, entry->count);
            fclose(file);
            return -1;
        }
    }
    fclose(file);
    return 0;
}

/* Whether a file can be opened and is another one than a checkpoint: the parameter file. */
static int is_other_file(const char *path) {
    char first[sizeof MAKER - 1] = "";
    FILE *file = fopen(path, "rb");
    size_t count;
    if (file == NULL) return 0;
    count = fread(first, 1, sizeof first, file);
    fclose(file);
    return count < sizeof first || memcmp(first, MAKER, sizeof first) != 0;
}

/* Write or read everything that is remembered; returns 0, or -1 with a message. OpenFAST gives the name of the checkpoint
 * in place of that of the parameter file; of a caller that goes on giving the latter, it is made of the output name. */
static int checkpoint(struct instance *all, const char *in, const char *out, double time, int writes, char *message,
                      size_t size) {
    char path[PATH_SIZE + 100], mark[sizeof FINGERPRINT] = "";
    int done = 0, fits = 1, named = in[0] != '\0' && strcmp(in, all->parameter_file) != 0 && !is_other_file(in);
    FILE *file;
    if (named) snprintf(path, sizeof path, "%s", in);
    else snprintf(path, sizeof path, "%s.%ld.checkpoint", out, lround(clip(1000.0 * time, -2e9, 2e9)));
    file = fopen(path, writes ? "wb" : "rb");
    if (file != NULL && writes) {
        done = fwrite(all, sizeof *all, 1, file) == 1;
    } else if (file != NULL) { /* the mark comes first: what belongs to another controller is left alone */
        done = fread(mark, sizeof mark, 1, file) == 1;
        fits = !done || memcmp(mark, FINGERPRINT, sizeof mark) == 0;
        if (done && fits) done = fseek(file, 0, SEEK_SET) == 0 && fread(all, sizeof *all, 1, file) == 1;
    }
    if (file != NULL && fclose(file) != 0) done = 0;
    if (!fits) {
        snprintf(message, size, "the checkpoint %.600s must be one of this controller", path);
    } else if (!done) {
        snprintf(message, size, "the checkpoint %.600s could not be %s", path, writes ? "written" : "read");
    }
    return done && fits ? 0 : -1;
}

/* ---- calls ------------------------------------------------------------------------------------------------------- */

/* What the actuators are asked for before the first step: what the caller says, else where the blades stand. */
static struct demand present_demand(const struct state *s, const float *swap) {
    struct demand d;
    int said = swap[46] > 0.0f && isfinite(swap[46]);
    for (int b = 0; b < N_BLADES; b++) said = said && fabs(swap[41 + b] - s->now.pitch[b]) < 0.2;
    for (int b = 0; b < N_BLADES; b++) d.pitch[b] = said ? swap[41 + b] : s->now.pitch[b];
    d.torque = said ? swap[46] : NAN;
    d.yaw_rate = 0.0;
    return d;
}

static void start(const struct parameters *p, struct state *s, double time) {
    struct demand present = s->present;
    s->count = 0;
    s->next_time = time;
    s->read_over = 1.0;
    s->true_speed = s->now.rotor_speed;
    inner_start(p, s, &present);
    additions_start(p, s);
#if WITH_GUARD
    guard_start(s, &present);
#endif
    if (isnan(present.torque)) present.torque = TRACKS_TIP_SPEED_RATIO ? s->torque : s->now.generator_torque;
#if WITH_SUPERVISOR
    supervisor_start(p, s, &present);
#endif
    s->base = s->demand = present;
#if WITH_AGENT
    agent_start(p, s);
#endif
    drives_start(s);
    s->running = s->provisional = 1;
}

static void step(const struct parameters *p, struct state *s) {
    double dt = p->controller_step;
#if WITH_AGENT
    int k = (int)(s->count % SUBSTEPS);
    if (k == 0) agent_act(p, s);
    controller_step(p, s, dt);
    agent_add(p, s, (k + 1.0) / SUBSTEPS, dt);
#else
    controller_step(p, s, dt);
    s->demand = s->base;
#endif
    if (s->count == 0) s->torque_before = s->torque_now = s->demand.torque;
    drives_take(p, s);
    s->step_time = s->next_time;
    s->count++;
    s->next_time += dt;
}

static void write_swap(float *swap, const struct demand *d) {
    for (int b = 0; b < N_BLADES; b++) swap[41 + b] = (float)d->pitch[b];
    swap[44] = (float)mean_of(d->pitch);
    swap[46] = (float)d->torque;
    swap[47] = (float)d->yaw_rate;
    swap[34] = 1.0f;                                     /* generator contactor on */
    swap[35] = 0.0f;                                     /* shaft brake off */
    swap[40] = swap[45] = 0.0f;                          /* no yaw torque, no pitch rate */
    swap[54] = swap[55] = 0.0f;                          /* pitch and torque are demanded here */
    swap[64] = 0.0f;                                     /* no values for logging */
    swap[101] = 0.0f;                                    /* yaw is demanded as a rate */
}

/* Say once which readings have no meaning. */
static void tell(struct state *s, char *message, size_t size, int *fail) {
    unsigned unsaid = missed(s) & ~s->told;
    int stands_in = unsaid & (1u << READ_GENERATOR_SPEED) && !(s->bad & (1u << READ_ROTOR_SPEED));
    size_t length;
    if (!unsaid) return;
    s->told |= unsaid;
    *fail = 1;
    snprintf(message, size, "no reading of");
    for (int k = 0; k < N_READINGS; k++)
        if (unsaid & (1u << k)) {
            length = strlen(message);
            snprintf(message + length, size - length, " %s (record %d)", READINGS[k].name, READINGS[k].record);
        }
    length = strlen(message);
    snprintf(message + length, size - length, "%s",
             !s->running ? ": without it there is nothing to start from"
             : !stands_in ? ": its last value is held, and what acts on it rests"
             : unsaid == 1u << READ_GENERATOR_SPEED ? ": the rotor speed stands in for it"
             : ": the rotor speed stands in for that of the generator, other last values are held, what acts on them rests");
}

static void call(float *swap, int *fail, const char *in, const char *out, char *message, size_t size) {
    struct parameters *p = &instance.parameters;
    struct state *s = &instance.state;
    int status = isfinite(swap[0]) ? (int)lround(clip(swap[0], -100.0, 100.0)) : 1;
    double time = swap[1], dt = swap[2];
    struct demand demands;
    if (!isfinite(time) || !isfinite(dt)) {
        snprintf(message, size, "time and interval must be finite, got %g s and %g s", time, dt);
        *fail = -1;
        return;
    }
    if (status == -8 || status == -9) {
        *fail = checkpoint(&instance, in, out, time, status == -8, message, size);
        return;
    }
    if (status < 0) return; /* the last call: what was demanded holds */
    dt = dt > 0.0 ? dt : p->controller_step;
    if (status == 0 || !s->running) {
        memset(&instance, 0, sizeof instance);
        memcpy(instance.fingerprint, FINGERPRINT, sizeof FINGERPRINT);
        *p = DEFAULTS;
        snprintf(instance.parameter_file, sizeof instance.parameter_file, "%s", in);
        if (in[0] != '\0' && read_parameters(p, in, message, size) != 0) {
            *fail = -1;
            return;
        }
#if WITH_SUPERVISOR
        if (supervisor_checked(p, in, message, size) != 0) {
            *fail = -1;
            return;
        }
#endif
        read_swap(p, s, swap, 0.0);
        if (s->bad_users & (FOR_BASE | FOR_SUPERVISOR)) {
            tell(s, message, size, fail);
            *fail = -1; /* without them there is nothing to start from */
            return;
        }
        s->present = present_demand(s, swap);
        start(p, s, time);
        if (INDIVIDUAL_BLADES && swap[27] != 1.0f) {
            *fail = 1;
            snprintf(message, size, "blades must be pitched one by one: record 28 must be 1 (OpenFAST: Ptch_Cntrl), got %g",
                     swap[27]);
        }
    } else if (s->provisional) {
        /* OpenFAST has not solved for its accelerations at the first call, and gives those of time zero at the second */
        s->provisional = 0;
        if (time < s->next_time - 0.5 * fmin(dt, p->controller_step)) {
            read_swap(p, s, swap, 0.0);
            if (!(s->bad_users & (FOR_BASE | FOR_SUPERVISOR))) {
                start(p, s, s->step_time); /* from the demand before the first call: the records have its answer */
                s->provisional = 0;
                step(p, s);
            }
        }
    }
    /* a step of the controller at the call nearest to it, several where calls are farther apart */
    if (time - s->next_time > 100.0 * p->controller_step) s->next_time = time;
    while (time >= s->next_time - 0.5 * fmin(dt, p->controller_step)) {
        read_swap(p, s, swap, s->count > 0 ? p->controller_step : 0.0);
        if (*fail == 0) tell(s, message, size, fail);
        step(p, s);
    }
    demands = s->demand;
    if (p->drive != 0.0) drives_move(p, s, time - s->step_time, dt, &demands);
    write_swap(swap, &demands);
}

/* Length of a string that a record gives, without the final null; the most where it gives none, and the null ends it. */
static int length_of(float record, size_t most) {
    return (int)(record >= 1.0f ? fmin(record - 1.0f, (double)most) : (double)most);
}

#if defined(_WIN32)
__declspec(dllexport)
#elif defined(__GNUC__)
__attribute__((visibility("default")))
#endif
void DISCON(float *avrSWAP, int *aviFAIL, const char *accINFILE, const char *avcOUTNAME, char *avcMSG);

/* The Bladed interface. Strings end with a null, or after the lengths in records 49 to 51. */
void DISCON(float *avrSWAP, int *aviFAIL, const char *accINFILE, const char *avcOUTNAME, char *avcMSG) {
    char in[PATH_SIZE], out[PATH_SIZE], message[1025] = "";
    int length = length_of(avrSWAP[48], sizeof message - 1);
    int n_in = length_of(avrSWAP[49], sizeof in - 1), n_out = length_of(avrSWAP[50], sizeof out - 1);
    *aviFAIL = 0;
    snprintf(in, sizeof in, "%.*s", n_in, accINFILE == NULL ? "" : accINFILE);
    snprintf(out, sizeof out, "%.*s", n_out, avcOUTNAME == NULL ? "" : avcOUTNAME);
    call(avrSWAP, aviFAIL, in, out, message, sizeof message);
    if (avcMSG != NULL && avrSWAP[48] >= 1.0f) snprintf(avcMSG, (size_t)length + 1, "%s", message);
}
