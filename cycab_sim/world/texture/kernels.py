"""What each material looks like at a point, as means over the footprint of the ray (see noise/kernels.py).

A material gives two numbers: `m`, a factor on the reflectance, and `t`, the share of the surface's second colour.
Points are in the frame of their surface: u along, v up, w out, in metres; p[0] is always the contrast.
"""

import math

from cycab_sim.world.noise.kernels import along, cells, fbm2, fbm3, hashed, joints, line, noise2, pulse, within
from sphere_nav.kernel_cache.kernels import njit

ASPHALT, PAVING, BRICK, PLASTER, STONE, WINDOW, ROOF, WOOD, SIGN = 0, 1, 2, 3, 4, 5, 6, 7, 8
METAL, MARKING, SOIL, BARK, FOLIAGE, SLATS, FACADE = 9, 10, 11, 12, 13, 14, 15
SIZES = (5.0, 4.0, 4.0, 4.5, 4.0, 1.6, 4.0, 1.5, 1.0, 1.6, 2.0, 4.0, 1.0, 1.0, 1.2, 12.0)  # m, of the coarsest octave
GAIN = 0.99  # every octave has nearly the same contrast
SKY_SIZE, SKY_GAIN, SKY_SEED = 1.3, 0.72, 7001
SKY_COLORS = (0.22, 0.42, 0.92), (0.38, 0.34, 0.93), (0.70, 0.14, 0.95)  # red, green, blue: overhead, horizon, clouds
VANISHED = 1e3  # a footprint that leaves no octave


@njit(cache=True)
def _asphalt(u, v, foot, p, seed, rough):
    patch = cells(u, v, 4.3, 2.9, 0.37, foot, seed + 40)
    warp = 0.35 * noise2(u / 0.6, v / 0.6, seed + 41)
    crack = abs(noise2(u / 2.2 + warp, v / 2.2 - warp, seed + 42)) * 1.6
    seam = abs(noise2(u / 7.0 - warp, v / 7.0, seed + 43)) * 5.0
    dark = 0.75 * line(crack, 0.02, foot) + 0.6 * line(seam, 0.035, foot)
    worn = 0.18 if patch > 0.55 else 0.0
    return (1.0 + p[0] * rough) * (1.0 - worn) * (1.0 - dark), max(0.0, 0.3 * patch)


@njit(cache=True)
def _blocks(u, v, foot, p, seed, rough):
    """Paving, bricks and ashlar: p = (contrast, cell u, cell v, gap, shift of every second row)."""
    tone = cells(u, v, p[1], p[2], p[4], foot, seed + 40)
    joint = joints(u, v, p[1], p[2], p[3], p[4], foot)
    return (1.0 + p[0] * rough + 0.16 * tone) * (1.0 - 0.25 * joint), min(1.0, joint + 0.12 * (1.0 + tone))


@njit(cache=True)
def _plaster(u, v, foot, p, seed, rough):
    streak = fbm2(u, 0.08 * v, foot, 0.5, 0.9, 4, seed + 20)
    warp = 0.4 * noise2(u / 0.5, v / 0.5, seed + 22)
    crack = line(abs(noise2(u / 1.7 + warp, v / 1.7, seed + 21)) * 1.3, 0.012, foot)
    dirt = math.exp(-max(v, 0.0) / 0.5) * (0.6 + 0.4 * noise2(u / 0.4, v / 0.4, seed + 23))
    return (1.0 + p[0] * rough + 0.06 * streak) * (1.0 - 0.5 * crack), min(1.0, max(0.0, dirt + 0.12 * streak))


@njit(cache=True)
def _window(u, v, foot, p, seed, rough):
    """Parameters p = (contrast, width, height, panes across, panes up, curtain 0..1): frame is the second colour."""
    frame = 1.0 - within(u, 0.06, p[1] - 0.06, foot[4]) * within(v, 0.06, p[2] - 0.06, foot[5])
    pane_u, pane_v = (p[1] - 0.06) / p[3], (p[2] - 0.06) / p[4]
    bars = pulse(u - 0.06, pane_u, 1.0 - 0.05 / pane_u, foot[4]) * pulse(v - 0.06, pane_v, 1.0 - 0.05 / pane_v, foot[5])
    frame = min(1.0, max(frame, 1.0 - bars))
    fold = fbm2(u, 0.05 * v, foot, 0.22, 0.8, 4, seed + 30)
    drawn = p[5] * (1.0 - within(u, 0.3 * p[1], 0.7 * p[1], 0.1 + foot[4]))
    glass = 1.0 + p[0] * rough + 0.5 * v / p[2] + drawn * (2.2 + 0.5 * fold)
    wear = 1.0 + 0.06 * fbm2(u, v, foot, 0.5, 0.95, 8, seed + 31)
    return glass * (1.0 - frame) + wear * frame, frame


@njit(cache=True)
def _roof(u, v, foot, p, seed, rough):
    tone = cells(u, v, 0.22, 0.30, 0.5, foot, seed + 40)
    lip = pulse(v, 0.30, 0.2, foot[5])
    groove = pulse(u, 0.22, 0.25, foot[4])
    return (1.0 + p[0] * rough + 0.18 * tone) * (1.0 - 0.35 * lip - 0.2 * groove), 0.15 * (1.0 + tone)


@njit(cache=True)
def _wood(u, v, foot, p, seed, rough):
    """Parameters p = (contrast, width, height): boards, grain and a panel frame."""
    grain = fbm2(u, 0.06 * v, foot, 0.12, 0.9, 6, seed)
    board = 1.0 - pulse(u, 0.14, 0.93, foot[4])
    inner = within(u, 0.12, p[1] - 0.12, foot[4]) * (1.0 - pulse(v + 0.1, 0.9, 0.16, foot[5]))
    return (1.0 + p[0] * rough + 0.14 * grain) * (1.0 - 0.5 * board), 0.5 * (1.0 - inner)


@njit(cache=True)
def _sign(u, v, foot, p, seed, rough):
    """Parameters p = (contrast, width, height, dot): rows of glyphs of 5 x 7 random, mirrored dots in a border."""
    dot = p[3]
    x, y = u / dot - 2.0, v / dot - 2.0
    border = 1.0 - within(u, dot, p[1] - dot, foot[4]) * within(v, dot, p[2] - dot, foot[5])
    inside = within(u, 2.0 * dot, p[1] - 2.0 * dot, foot[4]) * within(v, 2.0 * dot, p[2] - 2.0 * dot, foot[5])
    blur = max(foot[4], foot[5]) / dot
    ink = 0.0
    for tap in range(4):  # four points of the footprint, then the mean level where the glyphs are too small
        xs, ys = (
            x + (0.25 if tap & 1 else -0.25) * min(foot[4] / dot, 2.0),
            y + (0.25 if tap & 2 else -0.25) * min(foot[5] / dot, 2.0),
        )
        column, row = math.floor(xs / 6.0), math.floor(ys / 9.0)
        i, j = math.floor(xs - 6.0 * column), math.floor(ys - 9.0 * row)
        is_ink = i < 5 and j < 7 and hashed(min(i, 4 - i), j, int(column) + 31 * int(row), seed) > -0.1
        ink += 0.25 if is_ink else 0.0
    keep = math.exp(-0.35 * blur * blur)
    ink = (ink * keep + 0.36 * (1.0 - keep)) * inside
    return 1.0 + p[0] * rough, min(1.0, max(border, ink))


@njit(cache=True)
def _metal(u, v, foot, p, seed, rough):
    """Painted metal, dusty below and with panel lines every p[1] metres."""
    streak = fbm2(u, 0.1 * v, foot, 0.2, 0.9, 4, seed + 20)
    seam = 1.0 - pulse(u, p[1], 1.0 - 0.012 / p[1], foot[4])
    dust = max(0.0, 0.25 + 0.35 * rough) * math.exp(-max(v, 0.0) / 0.35)
    return (1.0 + p[0] * rough + 0.05 * streak) * (1.0 - 0.7 * seam), min(1.0, dust)


@njit(cache=True)
def _marking(u, v, foot, p, seed, rough):
    """Worn paint: p = (contrast, period, duty): dashes along u; asphalt is the second colour."""
    off = 1.0 - pulse(u, p[1], p[2], foot[4]) if p[2] < 1.0 else 0.0
    worn = min(1.0, max(0.0, 0.25 + 0.45 * fbm2(u, v, foot, 0.6, 0.9, 8, seed + 20)))
    return 1.0 + p[0] * rough, max(off, worn)


@njit(cache=True)
def _slats(u, v, foot, p, seed, rough):
    """Shutters, garage doors and benches: p = (contrast, slat height)."""
    gap = pulse(v, p[1], 0.22, foot[5])
    tone = cells(u, v, 50.0, p[1], 0.0, foot, seed + 40)
    return (1.0 + p[0] * rough + 0.05 * tone) * (1.0 - 0.55 * gap), 0.0


@njit(cache=True)
def _facade(u, v, foot, p, seed, rough):
    """A far house front: p = (contrast, bay, storey); windows are the second colour."""
    pane = pulse(u - 0.28 * p[1], p[1], 0.45, foot[4]) * pulse(v - 0.3 * p[2], p[2], 0.5, foot[5])
    tone = cells(u, v, p[1], p[2], 0.0, foot, seed + 40)
    return 1.0 + p[0] * rough + 0.25 * tone * pane, pane * (0.8 + 0.2 * tone)


@njit(cache=True)
def _solid(material, u, v, w, foot, p, seed):
    """Bark and foliage: noise in space, no flat frame."""
    if material == BARK:
        rough = fbm3(u, v, 0.15 * w, foot, 0.25, 0.9, 7, seed)
        return max(0.2, 1.0 + p[0] * rough), 0.0
    rough = fbm3(u, v, w, foot, 1.2, 1.0, 9, seed)
    return max(0.12, 1.0 + p[0] * rough), min(1.0, max(0.0, 0.4 + 0.3 * rough))


@njit(cache=True)
def appearance(material, u, v, w, foot, p, seed, rough):
    """Return (m, t) of a material: the factor on the reflectance and the share of the second colour.

    `rough` is the sum of octaves at the point, from 1 m or more down to the footprint.
    """
    place = u, v, foot, p, seed, rough
    if material == ASPHALT:
        return _asphalt(*place)
    if material in (PAVING, BRICK, STONE):
        return _blocks(*place)
    if material == PLASTER:
        return _plaster(*place)
    if material == WINDOW:
        return _window(*place)
    if material == ROOF:
        return _roof(*place)
    if material == WOOD:
        return _wood(*place)
    if material == SIGN:
        return _sign(*place)
    if material == METAL:
        return _metal(*place)
    if material == MARKING:
        return _marking(*place)
    if material == SLATS:
        return _slats(*place)
    if material == FACADE:
        return _facade(*place)
    if material == SOIL:
        return 1.0 + p[0] * rough, min(1.0, max(0.0, 0.5 + 0.35 * rough))
    return _solid(material, u, v, w, foot, p, seed)


@njit(cache=True, nogil=True)
def locate_surfaces(origin, rays, ranges, triangles, cone, surface_of, frames, kinds, points, depths, seeds):
    """Write where rays (N, 3) f32 meet their surfaces: points (8, N) f32 and seeds (N,) u4 for `sum_octaves`.

    origin (3,) f64 m, ranges (N,) f32 m, triangles (N,) i32, negative for the sky, cone (N,) f32 rad,
    surface_of (T,) i32, frames (S, 3, 4) f32 world to surface, kinds (S, 2) i32 (material, seed), depths (N,) f32: w
    """
    for n in range(rays.shape[0]):
        if triangles[n] < 0:
            x, y, width = 0.0, 0.0, VANISHED
            if triangles[n] == -1:
                scale = 1.0 / (max(rays[n, 2], 0.0) + 0.12)
                x, y, width = rays[n, 0] * scale, rays[n, 1] * scale, cone[n] * scale
            _note(points, n, x, y, (width, width, 1.0, 0.0), 1.0 / SKY_SIZE, SKY_GAIN)
            seeds[n] = SKY_SEED
            continue
        s, r = surface_of[triangles[n]], ranges[n]
        frame, ray = frames[s], rays[n]
        point = origin[0] + r * ray[0], origin[1] + r * ray[1], origin[2] + r * ray[2]
        u, v = along(frame, 0, point) + frame[0, 3], along(frame, 1, point) + frame[1, 3]
        depths[n] = along(frame, 2, point) + frame[2, 3]
        du, dv = along(frame, 0, ray), along(frame, 1, ray)
        is_solid = kinds[s, 0] == BARK or kinds[s, 0] == FOLIAGE
        inverse_size = VANISHED if is_solid else 1.0 / SIZES[kinds[s, 0]]
        _note(points, n, u, v, footprint(du, dv, r * cone[n]), inverse_size, GAIN)
        seeds[n] = kinds[s, 1]


@njit(cache=True)
def _note(points, n, u, v, ellipse, inverse_size, gain):
    points[0, n], points[1, n] = u, v
    points[2, n], points[3, n], points[4, n], points[5, n] = ellipse
    points[6, n], points[7, n] = inverse_size, gain


@njit(cache=True, nogil=True)
def dress(rays, triangles, surface_of, kinds, params, colors, points, depths, rough, albedo):
    """Write the linear colour (N, 3) f32 of each hit, reflectance 0..1, or the radiance of the sky.

    params (S, 6) f32, colours (S, 2, 3) f32, rough (N,) f32 of `sum_octaves`; the rest as in `locate_surfaces`
    """
    for n in range(rays.shape[0]):
        if triangles[n] < 0:
            _sky(rays[n, 2], rough[n], albedo, n)
            continue
        s = surface_of[triangles[n]]
        minor, major, bu, bv = points[2, n], points[3, n], points[4, n], points[5, n]
        fu = math.sqrt((minor * bv) ** 2 + (major * bu) ** 2)
        foot = (minor, major, bu, bv, fu, math.sqrt((minor * bu) ** 2 + (major * bv) ** 2))
        u, v, w = points[0, n], points[1, n], depths[n]
        m, t = appearance(kinds[s, 0], u, v, w, foot, params[s], kinds[s, 1], rough[n])
        m = min(2.5, max(0.06, m))
        for c in range(3):
            albedo[n, c] = m * (colors[s, 0, c] * (1.0 - t) + colors[s, 1, c] * t)


@njit(cache=True)
def footprint(du, dv, minor):
    """Return axes and direction of the ellipse that a cone of width `minor` cuts out of the plane w = const.

    (du, dv) are the first two components of the unit ray in the frame of the surface.
    """
    flat = math.sqrt(du * du + dv * dv)
    slope = math.sqrt(max(1.0 - flat * flat, 0.0009))
    bu, bv = (du / flat, dv / flat) if flat > 1e-6 else (1.0, 0.0)
    return minor, minor / slope, bu, bv


@njit(cache=True)
def _sky(z, rough, color, n):
    """Radiance of the sky: paler towards the horizon, with clouds on a plane overhead."""
    up = max(z, 0.0)
    cover = 0.5 + 0.42 * rough
    shade = 0.85 + 0.2 * cover
    cover = min(1.0, max(0.0, cover)) * min(1.0, 0.3 + 4.0 * up)
    pale = math.exp(-3.5 * up)
    for c in range(3):
        clear, horizon, cloud = SKY_COLORS[c]
        color[n, c] = (clear + horizon * pale) * (1.0 - cover) + cloud * shade * cover
