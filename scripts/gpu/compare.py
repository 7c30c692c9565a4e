"""What CUDA adds: gsplat's renderer beside ours on the CPU, and SAM by kornia. Prints one line each."""

import time
from collections.abc import Callable

import numpy as np
import torch

from gvla2.geometry.camera import Camera
from gvla2.geometry.gaussians import Gaussians
from gvla2.reconstruction.rasteriser import Rasteriser

SIDE, COUNTS = 512, (10_000, 100_000, 1_000_000)


def seconds(act: Callable[[], object], times: int) -> float:
    """Median seconds of ``act`` after a first call that does not count."""
    found = []
    for _ in range(times + 1):
        torch.cuda.synchronize()
        started = time.perf_counter()
        act()
        torch.cuda.synchronize()
        found.append(time.perf_counter() - started)
    return float(np.median(found[1:]))


def cloud(count: int) -> Gaussians:
    """Gaussians in a ball of 0.2 m about the origin."""
    rng = np.random.default_rng(0)
    centres = rng.normal(size=(count, 3))
    centres *= 0.2 * rng.random((count, 1)) ** (1 / 3) / np.linalg.norm(centres, axis=1, keepdims=True)
    scales = np.log(0.2 / count ** (1 / 3)) + 0.3 * rng.normal(size=(count, 3))
    return Gaussians(
        centres, scales, rng.normal(size=(count, 4)), rng.normal(size=count), rng.normal(size=(count, 3))
    )


def renderers() -> None:
    """Our renderer and gsplat's of the same Gaussians: the largest and mean difference of pictures, and seconds."""
    from gsplat import rasterization

    pose = np.eye(4)
    pose[2, 3] = -0.8
    camera = Camera.from_fov(40.0, pose, SIDE, SIDE)
    ours = Rasteriser(0.3, 0.01)
    for count in COUNTS:
        gaussians = cloud(count)
        on_gpu = {name: torch.tensor(value, device="cuda") for name, value in vars(gaussians).items()}
        view = torch.tensor(np.linalg.inv(pose), dtype=torch.float32, device="cuda")[None]
        lens = torch.tensor(camera.K, dtype=torch.float32, device="cuda")[None]
        colours = (0.5 + 0.28209479177387814 * on_gpu["sh_dc"]).clamp(min=0.0)

        def draw(on_gpu=on_gpu, view=view, lens=lens, colours=colours) -> torch.Tensor:
            picture, alpha, _ = rasterization(
                on_gpu["centres"],
                torch.nn.functional.normalize(on_gpu["rotations"], dim=1),
                on_gpu["log_scales"].exp(),
                on_gpu["opacity_logits"].sigmoid(),
                colours,
                view,
                lens,
                SIDE,
                SIDE,
                near_plane=0.01,
            )
            return picture[0] + (1.0 - alpha[0])

        theirs = draw().cpu().numpy()
        apart = np.abs(theirs.clip(0, 1) - ours.render(gaussians, camera)[0])
        cpu, gpu = seconds(lambda g=gaussians: ours.render(g, camera), 5), seconds(draw, 20)
        print(
            f"{count} Gaussians, {SIDE} px: numba {1e3 * cpu:.1f} ms, gsplat {1e3 * gpu:.2f} ms; "
            f"pictures differ by {apart.mean():.5f} in the mean, {apart.max():.3f} at most",
            flush=True,
        )


def segmenter() -> None:
    """SAM's two sizes with random weights: seconds of a picture's embedding and of sixteen prompts."""
    from kornia.models.sam import Sam, SamConfig

    for name in ("vit_b", "vit_h"):
        model = Sam.from_config(SamConfig(name)).eval().cuda()
        picture = torch.rand(1, 3, 1024, 1024, device="cuda")
        points = (
            1024 * torch.rand(16, 1, 2, device="cuda"),
            torch.ones(16, 1, device="cuda", dtype=torch.int64),
        )

        @torch.inference_mode()
        def see(model=model, picture=picture) -> torch.Tensor:
            return model.image_encoder(picture)

        seen = see()

        @torch.inference_mode()
        def prompt(model=model, seen=seen, points=points) -> object:
            sparse, dense = model.prompt_encoder(points=points, boxes=None, masks=None)
            return model.mask_decoder(
                image_embeddings=seen,
                image_pe=model.prompt_encoder.get_dense_pe(),
                sparse_prompt_embeddings=sparse,
                dense_prompt_embeddings=dense,
                multimask_output=True,
            )

        times = [f"{1e3 * seconds(act, 10):.1f} ms" for act in (see, prompt)]
        print(f"SAM {name}: a picture {times[0]}, sixteen prompts {times[1]}", flush=True)


if __name__ == "__main__":
    print(torch.cuda.get_device_name(), torch.__version__, flush=True)
    for compare in (segmenter, renderers):
        try:
            compare()
        except Exception as error:
            print(f"{compare.__name__}: {type(error).__name__}: {error}", flush=True)
