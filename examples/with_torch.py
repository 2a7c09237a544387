"""The index of a glass ball, by a loss and an optimiser of PyTorch; needs the extra `torch`."""

import torch
from common import SCENES, arguments

import whitted as wt

if __name__ == "__main__":
    asked = arguments(__doc__)
    asked.output.mkdir(parents=True, exist_ok=True)
    size = (asked.size, asked.size)
    scene = wt.load_scene(SCENES / "cornell.toml")
    target = torch.from_numpy(wt.render(scene, 4, resolution=size).numpy().copy())
    index = torch.tensor(1.6, requires_grad=True)
    optimiser = torch.optim.Adam([index], lr=0.01)
    for iteration in range(60):
        optimiser.zero_grad()
        image = wt.torch_render(scene, {"materials.glass.ior": index}, spp=1, resolution=size)
        # Of logarithms, so that dark pixels weigh as much as bright ones
        loss = torch.nn.functional.mse_loss(torch.log1p(8 * image), torch.log1p(8 * target))
        loss.backward()
        optimiser.step()
        if iteration % 10 == 0:
            print(f"{iteration:3} loss {loss.item():.3e} index {index.item():.5f}")
    print(f"true 1.5, found {index.item():.5f}")
    wt.write_image(asked.output / "with-torch-found.png", image.detach())
