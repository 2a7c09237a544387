"""Renders from several threads, in a process of its own, as a failure hangs or ends it."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
RENDERS = """
import sys, threading
import numpy as np
import whitted as wt

scene = wt.load_scene(sys.argv[1])
images = []

def work():
    for _ in range(10):
        images.append(wt.render(scene, resolution=(24, 24)).numpy())

first = wt.render(scene, resolution=(24, 24)).numpy()
threads = [threading.Thread(target=work) for _ in range(4)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print(sum(np.array_equal(image, first) for image in images))
"""


def test_four_threads_render_the_same_image():
    command = [sys.executable, "-c", RENDERS, str(ROOT / "scenes" / "three_diffuse.toml")]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=100)
    assert (process.returncode, process.stdout) == (0, "40\n"), process.stderr
