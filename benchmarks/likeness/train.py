"""`python -m benchmarks.likeness.train --pairs FOLDER -o weights.npz`: train the learned likeness of `mcl_depth`.

Needs `pip install torch` beside the environment of the project; the product does not. Pairs of images and depths are
drawn by `pairs.py` when they are not in the folder yet. Deterministic for its seed, on one processor thread.

Loss: an image must find its own depth panorama and heading among those of other places of the same map, some of them a
few metres off, their mirror images, and all other headings (InfoNCE, van den Oord 2018). Similarity is what the filter
uses: the circular correlation of both feature maps, without their mean over azimuth, of length 1.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from benchmarks.likeness.pairs import J_ANYWHERE, J_NEAR, Scene, scenes
from mcl_depth.constants import NUM_FREQUENCIES
from mcl_depth.geometry.synthesis import panorama_window
from mcl_depth.likeness.encoder import INPUTS, Encoder, EncoderPair, depth_inputs, image_inputs, load_encoders
from mcl_depth.params import SynthesisParams

LAYERS = {  # outputs, rows and columns of the filter, strides over rows and columns
    "image": ((16, 5, 5, 2, 2), (24, 3, 3, 2, 1), (24, 3, 3, 1, 1), (32, 3, 3, 1, 1), (8, 1, 1, 1, 1)),
    "depth": ((16, 5, 5, 2, 2), (24, 3, 3, 2, 1), (24, 3, 3, 1, 1), (8, 1, 1, 1, 1)),
}
TRAIN = {"towns": range(301, 303), "corridors": range(16), "homes": range(12)}
NEAR_M, NEAR_COLUMNS = 0.8, 5  # a place and a heading this close to the true ones is neither right nor wrong
BATCH, RATE, SHARPNESS, MAX_SHARPNESS = 14, 2e-3, 12.0, 40.0
WINDOW = panorama_window(SynthesisParams())


class Network(nn.Module):
    """A chain of convolutions whose columns wrap around, as `Encoder` runs it."""

    def __init__(self, side: str) -> None:
        super().__init__()
        sizes = [INPUTS[side], *(layer[0] for layer in LAYERS[side])]
        self.layers = nn.ModuleList(
            nn.Conv2d(n, o, (h, w), (sy, sx)) for n, (o, h, w, sy, sx) in zip(sizes[:-1], LAYERS[side], strict=True)
        )

    def forward(self, x: Tensor) -> Tensor:
        """Return the features (M, C, h, w) of inputs (M, n, H, W)."""
        for number, layer in enumerate(self.layers):
            h, w = layer.kernel_size
            x = functional.pad(x, (w // 2, w // 2, 0, 0), mode="circular")
            x = layer(functional.pad(x, (0, 0, h // 2, h // 2)))
            x = functional.relu(x) if number < len(self.layers) - 1 else x
        return x

    def encoder(self) -> Encoder:
        """Return the same for the product."""
        table, values = [], []
        for layer in self.layers:
            table.append((layer.in_channels, layer.out_channels, *layer.kernel_size, *layer.stride))
            values += [layer.weight.detach().numpy().ravel(), layer.bias.detach().numpy()]
        return Encoder(np.array(table, np.int64), np.concatenate(values).astype(np.float32))


def spectra_of(features: Tensor) -> Tensor:
    """Return the spectra (M, P, F) over azimuth that the filter keeps, of length 1."""
    spectra = torch.fft.rfft(features.flatten(1, 2), dim=-1)[..., 1:NUM_FREQUENCIES]
    power = (spectra.real**2 + spectra.imag**2).sum(dim=(1, 2), keepdim=True)
    return spectra / torch.sqrt(2.0 * power + 1e-12)


def correlate(images: Tensor, depths: Tensor, count: int) -> Tensor:
    """Return the similarity (B, D, count) of spectra of images (B, P, F) and depths (D, P, F) at all headings."""
    products = torch.einsum("bpf,dpf->bdf", images, depths.conj())
    full = functional.pad(products, (1, count // 2 - products.shape[-1]))
    return torch.fft.irfft(full, n=count, dim=-1, norm="forward")


class Prepared:
    """A scene with the inputs of its images made."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.images = torch.from_numpy(
            np.stack([image_inputs(image.astype(np.float32), None, WINDOW) for image in scene.images])
        )

    def depths(self, indices: np.ndarray, which: np.ndarray, rng: np.random.Generator | None) -> Tensor:
        """Return the inputs (N, 4, H, W) of depths `which` (N,) of places `indices` (N,); with holes to train on."""
        ranges = self.scene.depths[indices, which].astype(np.float32)
        if rng is not None:
            ranges[rng.random(ranges.shape) < rng.uniform(0.0, 0.04)] = np.nan
        return torch.from_numpy(depth_inputs(ranges, WINDOW))


def loss_of(nets: nn.ModuleDict, sharpness: Tensor, made: Prepared, rng: np.random.Generator) -> Tensor:
    """Return the loss of some images of a scene."""
    scene = made.scene
    chosen = rng.permutation(len(scene.images))[:BATCH]
    count, width = len(chosen), WINDOW.width
    is_mirrored = bool(rng.random() < 0.5)
    rolls = rng.integers(width, size=count)
    images = made.images[chosen]
    images = torch.flip(images, (-1,)) if is_mirrored else images
    images = torch.stack([torch.roll(image, int(roll), -1) for image, roll in zip(images, rolls, strict=True)])
    noise = torch.from_numpy(rng.standard_normal(images[:, :-1].shape, dtype=np.float32))
    images = torch.cat([images[:, :-1] + float(rng.uniform(0.0, 0.25)) * noise, images[:, -1:]], dim=1)
    near = rng.integers(J_NEAR, size=count)
    wrong = rng.integers(J_NEAR + J_ANYWHERE, scene.depths.shape[1], size=count)
    others = rng.integers(J_NEAR, J_NEAR + J_ANYWHERE, size=count)
    indices, which = np.tile(chosen, 3), np.concatenate([near, wrong, others])
    inputs = made.depths(indices, which, rng)
    inputs = torch.flip(inputs, (-1,)) if is_mirrored else inputs
    mirrors = count // 2
    inputs = torch.cat([inputs, torch.flip(inputs[:mirrors], (-1,))])  # mirror images of the right places
    curves = correlate(spectra_of(nets["image"](images)), spectra_of(nets["depth"](inputs)), width)
    places = torch.from_numpy(scene.depth_places[indices, which] - np.zeros(2))
    true = torch.from_numpy(scene.places[chosen] - np.zeros(2))
    is_near = torch.cdist(true, places) < NEAR_M
    is_near = torch.cat([is_near, torch.zeros(count, mirrors, dtype=torch.bool)], dim=1)
    if scene.kind == "corridor":  # which is its own mirror image
        is_near[:, -mirrors:] = torch.eye(count, mirrors, dtype=torch.bool)
    headings = torch.arange(width)[None, :] - torch.from_numpy(rolls)[:, None]
    off = torch.minimum(headings % width, -headings % width)
    is_close = off <= NEAR_COLUMNS
    logits = sharpness.clamp(1.0, MAX_SHARPNESS) * curves
    right = logits[torch.arange(count), torch.arange(count), torch.from_numpy(rolls)]
    undecided = is_near[:, :, None] & is_close[:, None, :]
    if scene.kind == "corridor":  # turned by half a circle it fits its mirror image, too
        half = torch.roll(is_close, width // 2, dims=1)
        undecided[:, -mirrors:] |= is_near[:, -mirrors:, None] & half[:, None, :]
    wrongs = logits.masked_fill(undecided, -1e4).flatten(1)
    return (torch.logsumexp(torch.cat([right[:, None], wrongs], dim=1), dim=1) - right).mean()


def train(parts: Sequence[Prepared], steps: int, seed: int, minutes: float, output: Path) -> None:
    """Write what so many steps make of the pairs; what it is worth is told by the benchmarks of bare geometry."""
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)
    rng, begin = np.random.default_rng(seed), time.process_time()
    nets = nn.ModuleDict({side: Network(side) for side in LAYERS})
    sharpness = nn.Parameter(torch.tensor(SHARPNESS))
    optimizer = torch.optim.Adam([{"params": nets.parameters()}, {"params": [sharpness], "lr": 0.05}], lr=RATE)
    plan = torch.optim.lr_scheduler.OneCycleLR(optimizer, [RATE, 0.05], total_steps=steps, pct_start=0.1)
    by_kind = {kind: [p for p in parts if p.scene.kind == kind] for kind in sorted({p.scene.kind for p in parts})}
    kinds, losses = list(by_kind), []
    for step in range(steps):
        made = by_kind[kinds[step % len(kinds)]]
        loss = loss_of(nets, sharpness, made[int(rng.integers(len(made)))], rng)
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(nets.parameters(), 1.0)
        optimizer.step()
        plan.step()
        losses.append(loss.item())
        if (step + 1) % 100 == 0 or step + 1 == steps:
            words = [f"step {step + 1}", f"loss {np.mean(losses[-100:]):.3f}", f"sharpness {sharpness.item():.1f}"]
            say(", ".join([*words, f"{time.process_time() - begin:.0f} s of CPU"]))
            hours = (minutes + (time.process_time() - begin) / 60.0) / 60.0
            _pair(nets, f"--seed {seed} --steps {steps}, {step + 1} done; {hours:.2f} h of CPU").save(output)


def _pair(nets: nn.ModuleDict, words: str) -> EncoderPair:
    """Return the encoders as the product takes them; `words` say where they come from."""
    seeds = ", ".join(f"{kind} {seeds.start} to {seeds.stop - 1}" for kind, seeds in TRAIN.items())
    text = f"benchmarks/likeness/train.py {words}; {seeds}; torch {torch.__version__}"
    sides = {side: nets[side].encoder() for side in LAYERS}
    elevations = (SynthesisParams().elevation_min_deg, SynthesisParams().elevation_max_deg)
    return EncoderPair(**sides, num_columns=WINDOW.width, elevations_deg=elevations, provenance=text)


def say(text: str) -> None:
    """Write a line."""
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def main() -> None:
    """Draw what is missing, train, write the weights."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=Path, required=True, help="folder of the pairs, 1 GB")
    parser.add_argument("-o", "--output", type=Path, required=True, help="file of the weights, .npz")
    parser.add_argument("--steps", type=int, default=1300, help="of the training (1300)")
    parser.add_argument("--seed", type=int, default=1, help="of the first weights and of all draws (1)")
    options = parser.parse_args()
    begin = time.process_time()
    parts = [Prepared(scene) for scene in scenes(options.pairs, **TRAIN)]
    minutes = (time.process_time() - begin) / 60.0
    train(parts, options.steps, options.seed, minutes, options.output)
    say(f"{options.output}: {load_encoders(options.output).digest}, {options.output.stat().st_size} bytes")


if __name__ == "__main__":
    main()
