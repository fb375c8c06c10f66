"""Makes the pictures of the AprilTags, tag36h11_00.png and so on: python models/tags/make_tags.py [folder].

Needs OpenCV (pip install 'pace_drake[perception]'). The pictures are committed, so that showing tags needs it not.
"""

import sys
from pathlib import Path

import cv2
import numpy as np

NUM_TAGS = 16
CELL = 16  # [px]


def picture(number: int) -> np.ndarray:
    """(160, 160) uint8: eight cells of tag, black border included, and a white margin of one cell."""
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    cells = np.pad(cv2.aruco.generateImageMarker(family, number, 8, borderBits=1), 1, constant_values=255)
    return np.kron(cells, np.ones((CELL, CELL), dtype=np.uint8))


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    for number in range(NUM_TAGS):
        if not cv2.imwrite(str(folder / f"tag36h11_{number:02d}.png"), picture(number)):
            sys.exit(f"{folder}: cannot write there")
