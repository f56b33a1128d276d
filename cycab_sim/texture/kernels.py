"""What each material looks like at a point, as means over the footprint of the ray (see noise/kernels.py).

A material gives two numbers: `m`, a factor on the reflectance, and `t`, the share of the surface's second colour.
Points are in the frame of their surface: u along, v up, w out, in metres; p[0] is always the contrast.
"""

import math

from numba import njit

from cycab_sim.noise.kernels import cells, fbm2, fbm3, hashed, joints, line, noise2, pulse, within

ASPHALT, PAVING, BRICK, PLASTER, STONE, WINDOW, ROOF, WOOD, SIGN = 0, 1, 2, 3, 4, 5, 6, 7, 8
METAL, MARKING, SOIL, BARK, FOLIAGE, SLATS, FACADE = 9, 10, 11, 12, 13, 14, 15


@njit(cache=True)
def _asphalt(u, v, foot, p, seed):
    rough = fbm2(u, v, foot, 5.0, 0.99, 11, seed)
    patch = cells(u, v, 4.3, 2.9, 0.37, foot, seed + 40)
    warp = 0.35 * noise2(u / 0.6, v / 0.6, seed + 41)
    crack = abs(noise2(u / 2.2 + warp, v / 2.2 - warp, seed + 42)) * 1.6
    seam = abs(noise2(u / 7.0 - warp, v / 7.0, seed + 43)) * 5.0
    dark = 0.75 * line(crack, 0.02, foot) + 0.6 * line(seam, 0.035, foot)
    worn = 0.18 if patch > 0.55 else 0.0
    return (1.0 + p[0] * rough) * (1.0 - worn) * (1.0 - dark), max(0.0, 0.3 * patch)


@njit(cache=True)
def _blocks(u, v, foot, p, seed):
    """Paving, bricks and ashlar: p = (contrast, cell u, cell v, gap, shift of every second row)."""
    rough = fbm2(u, v, foot, 4.0, 0.99, 11, seed)
    tone = cells(u, v, p[1], p[2], p[4], foot, seed + 40)
    joint = joints(u, v, p[1], p[2], p[3], p[4], foot)
    return (1.0 + p[0] * rough + 0.16 * tone) * (1.0 - 0.25 * joint), min(1.0, joint + 0.12 * (1.0 + tone))


@njit(cache=True)
def _plaster(u, v, foot, p, seed):
    rough = fbm2(u, v, foot, 4.5, 0.99, 11, seed)
    streak = fbm2(u, 0.08 * v, foot, 0.5, 0.9, 4, seed + 20)
    warp = 0.4 * noise2(u / 0.5, v / 0.5, seed + 22)
    crack = line(abs(noise2(u / 1.7 + warp, v / 1.7, seed + 21)) * 1.3, 0.012, foot)
    dirt = math.exp(-max(v, 0.0) / 0.5) * (0.6 + 0.4 * noise2(u / 0.4, v / 0.4, seed + 23))
    return (1.0 + p[0] * rough + 0.06 * streak) * (1.0 - 0.5 * crack), min(1.0, max(0.0, dirt + 0.12 * streak))


@njit(cache=True)
def _window(u, v, foot, p, seed):
    """Parameters p = (contrast, width, height, panes across, panes up, curtain 0..1): frame is the second colour."""
    frame = 1.0 - within(u, 0.06, p[1] - 0.06, foot[4]) * within(v, 0.06, p[2] - 0.06, foot[5])
    pane_u, pane_v = (p[1] - 0.06) / p[3], (p[2] - 0.06) / p[4]
    bars = pulse(u - 0.06, pane_u, 1.0 - 0.05 / pane_u, foot[4]) * pulse(v - 0.06, pane_v, 1.0 - 0.05 / pane_v, foot[5])
    frame = min(1.0, max(frame, 1.0 - bars))
    mirrored = fbm2(u, v, foot, 1.6, 0.85, 8, seed)
    fold = fbm2(u, 0.05 * v, foot, 0.22, 0.8, 4, seed + 30)
    drawn = p[5] * (1.0 - within(u, 0.3 * p[1], 0.7 * p[1], 0.1 + foot[4]))
    glass = 1.0 + p[0] * mirrored + 0.5 * v / p[2] + drawn * (2.2 + 0.5 * fold)
    wear = 1.0 + 0.06 * fbm2(u, v, foot, 0.5, 0.95, 8, seed + 31)
    return glass * (1.0 - frame) + wear * frame, frame


@njit(cache=True)
def _roof(u, v, foot, p, seed):
    rough = fbm2(u, v, foot, 4.0, 0.99, 10, seed)
    tone = cells(u, v, 0.22, 0.30, 0.5, foot, seed + 40)
    lip = pulse(v, 0.30, 0.2, foot[5])
    groove = pulse(u, 0.22, 0.25, foot[4])
    return (1.0 + p[0] * rough + 0.18 * tone) * (1.0 - 0.35 * lip - 0.2 * groove), 0.15 * (1.0 + tone)


@njit(cache=True)
def _wood(u, v, foot, p, seed):
    """Parameters p = (contrast, width, height): boards, grain and a panel frame."""
    grain = fbm2(u, 0.06 * v, foot, 0.12, 0.9, 6, seed)
    rough = fbm2(u, v, foot, 1.5, 0.99, 9, seed + 10)
    board = 1.0 - pulse(u, 0.14, 0.93, foot[4])
    inner = within(u, 0.12, p[1] - 0.12, foot[4]) * (1.0 - pulse(v + 0.1, 0.9, 0.16, foot[5]))
    return (1.0 + p[0] * rough + 0.14 * grain) * (1.0 - 0.5 * board), 0.5 * (1.0 - inner)


@njit(cache=True)
def _sign(u, v, foot, p, seed):
    """Parameters p = (contrast, width, height, dot): rows of glyphs of 5 x 7 random, mirrored dots in a border."""
    rough = fbm2(u, v, foot, 1.0, 0.99, 9, seed)
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
def _metal(u, v, foot, p, seed):
    """Painted metal, dusty below and with panel lines every p[1] metres."""
    rough = fbm2(u, v, foot, 1.6, 0.99, 10, seed)
    streak = fbm2(u, 0.1 * v, foot, 0.2, 0.9, 4, seed + 20)
    seam = 1.0 - pulse(u, p[1], 1.0 - 0.012 / p[1], foot[4])
    dust = max(0.0, 0.25 + 0.35 * rough) * math.exp(-max(v, 0.0) / 0.35)
    return (1.0 + p[0] * rough + 0.05 * streak) * (1.0 - 0.7 * seam), min(1.0, dust)


@njit(cache=True)
def _marking(u, v, foot, p, seed):
    """Worn paint: p = (contrast, period, duty): dashes along u; asphalt is the second colour."""
    rough = fbm2(u, v, foot, 2.0, 0.99, 10, seed)
    off = 1.0 - pulse(u, p[1], p[2], foot[4]) if p[2] < 1.0 else 0.0
    worn = min(1.0, max(0.0, 0.25 + 0.45 * fbm2(u, v, foot, 0.6, 0.9, 8, seed + 20)))
    return 1.0 + p[0] * rough, max(off, worn)


@njit(cache=True)
def _slats(u, v, foot, p, seed):
    """Shutters, garage doors and benches: p = (contrast, slat height)."""
    rough = fbm2(u, v, foot, 1.2, 0.99, 10, seed)
    gap = pulse(v, p[1], 0.22, foot[5])
    tone = cells(u, v, 50.0, p[1], 0.0, foot, seed + 40)
    return (1.0 + p[0] * rough + 0.05 * tone) * (1.0 - 0.55 * gap), 0.0


@njit(cache=True)
def _facade(u, v, foot, p, seed):
    """A far house front: p = (contrast, bay, storey); windows are the second colour."""
    rough = fbm2(u, v, foot, 12.0, 0.99, 11, seed)
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
def appearance(material, u, v, w, foot, p, seed):
    """Return (m, t) of a material: the factor on the reflectance and the share of the second colour."""
    if material == ASPHALT:
        return _asphalt(u, v, foot, p, seed)
    if material in (PAVING, BRICK, STONE):
        return _blocks(u, v, foot, p, seed)
    if material == PLASTER:
        return _plaster(u, v, foot, p, seed)
    if material == WINDOW:
        return _window(u, v, foot, p, seed)
    if material == ROOF:
        return _roof(u, v, foot, p, seed)
    if material == WOOD:
        return _wood(u, v, foot, p, seed)
    if material == SIGN:
        return _sign(u, v, foot, p, seed)
    if material == METAL:
        return _metal(u, v, foot, p, seed)
    if material == MARKING:
        return _marking(u, v, foot, p, seed)
    if material == SLATS:
        return _slats(u, v, foot, p, seed)
    if material == FACADE:
        return _facade(u, v, foot, p, seed)
    if material == SOIL:
        rough = fbm2(u, v, foot, 4.0, 0.98, 11, seed)
        return 1.0 + p[0] * rough, min(1.0, max(0.0, 0.5 + 0.35 * rough))
    return _solid(material, u, v, w, foot, p, seed)


@njit(cache=True, nogil=True)
def paint(origin, rays, ranges, triangles, cone, surface_of, frames, kinds, params, colours, albedo):
    """Write the linear colour (N, 3) f32 of each hit, reflectance 0..1, or the radiance of the sky.

    origin (3,) f64 m, rays (N, 3) f32 unit world, ranges (N,) f32 m, triangles (N,) i32, -1 where nothing was hit,
    cone (N,) f32 rad, surface_of (T,) i32, frames (S, 3, 4) f32 world to surface, kinds (S, 2) i32 (material, seed),
    params (S, 6) f32, colours (S, 2, 3) f32
    """
    for n in range(rays.shape[0]):
        if triangles[n] < 0:
            _sky(rays[n, 0], rays[n, 1], rays[n, 2], cone[n], albedo[n])
            continue
        s = surface_of[triangles[n]]
        A = frames[s]
        x, y, z = (
            origin[0] + ranges[n] * rays[n, 0],
            origin[1] + ranges[n] * rays[n, 1],
            origin[2] + ranges[n] * rays[n, 2],
        )
        u = A[0, 0] * x + A[0, 1] * y + A[0, 2] * z + A[0, 3]
        v = A[1, 0] * x + A[1, 1] * y + A[1, 2] * z + A[1, 3]
        w = A[2, 0] * x + A[2, 1] * y + A[2, 2] * z + A[2, 3]
        m, t = appearance(kinds[s, 0], u, v, w, _footprint(A, rays[n], ranges[n] * cone[n]), params[s], kinds[s, 1])
        m = min(2.5, max(0.06, m))
        for c in range(3):
            albedo[n, c] = m * (colours[s, 0, c] * (1.0 - t) + colours[s, 1, c] * t)


@njit(cache=True)
def _footprint(A, ray, minor):
    """Return the ellipse that a cone of diameter `minor` around the ray cuts out of the plane w = const."""
    du = A[0, 0] * ray[0] + A[0, 1] * ray[1] + A[0, 2] * ray[2]
    dv = A[1, 0] * ray[0] + A[1, 1] * ray[1] + A[1, 2] * ray[2]
    flat = math.sqrt(du * du + dv * dv)
    slope = math.sqrt(max(1.0 - flat * flat, 0.0009))
    bu, bv = (du / flat, dv / flat) if flat > 1e-6 else (1.0, 0.0)
    major = minor / slope
    fu = math.sqrt((minor * bv) ** 2 + (major * bu) ** 2)
    return minor, major, bu, bv, fu, math.sqrt((minor * bu) ** 2 + (major * bv) ** 2)


@njit(cache=True)
def _sky(x, y, z, cone, colour):
    """Radiance of the sky: paler towards the horizon, with clouds on a plane overhead."""
    up = max(z, 0.0)
    scale = 1.0 / (up + 0.12)
    foot = (cone * scale, cone * scale, 1.0, 0.0, cone * scale, cone * scale)
    cover = 0.5 + 0.42 * fbm2(x * scale, y * scale, foot, 1.3, 0.72, 8, 7001)
    shade = 0.85 + 0.2 * cover
    cover = min(1.0, max(0.0, cover)) * min(1.0, 0.3 + 4.0 * up)
    pale = math.exp(-3.5 * up)
    colour[0] = (0.22 + 0.42 * pale) * (1.0 - cover) + 0.92 * shade * cover
    colour[1] = (0.38 + 0.34 * pale) * (1.0 - cover) + 0.93 * shade * cover
    colour[2] = (0.70 + 0.14 * pale) * (1.0 - cover) + 0.95 * shade * cover
