import numpy as np
import pytest

from gvla2.errors import GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.mesh import Texture, TexturedMesh, TriangleMesh
from gvla2.geometry.raycast import RayCaster, Surface
from gvla2.geometry.transform import look_along

SIDE = 0.4


def card(image: np.ndarray) -> TexturedMesh:
    """A square card in the plane z = 0 with a picture on it, its upper edge at +y."""
    corners = SIDE * np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32)[faces]
    return TexturedMesh(
        TriangleMesh(corners, faces),
        uv,
        np.zeros(2, dtype=np.int64),
        np.ones((2, 3, 3), dtype=np.float32),
        (image,),
    )


def quarters(size: int) -> np.ndarray:
    image = np.zeros((size, size, 3), dtype=np.uint8)
    half = size // 2
    image[:half, :half], image[:half, half:] = (250, 0, 0), (0, 250, 0)
    image[half:, :half], image[half:, half:] = (0, 0, 250), (250, 250, 0)
    return image


def picture(textured: TexturedMesh, size: int) -> np.ndarray:
    surface = Surface(textured.mesh.vertices, textured.mesh.faces, np.ones(3), 0, Texture.of(textured))
    camera = Camera.from_fov(np.deg2rad(30), look_along((0.0, 0.0, 1.0), (0.0, 0.0, -1.0)), size, size)
    (seen,) = RayCaster([surface]).cast([camera], {})
    middle = np.array([[x * SIDE / 4, y * SIDE / 4, 0.0] for y in (1, -1) for x in (-1, 1)])
    uv, _ = camera.project(middle)
    return np.array([seen.image[int(v), int(u)] for u, v in uv]).astype(int)


@pytest.mark.parametrize("texels", [8, 64, 1024])
def test_a_picture_is_seen_where_it_is_painted(texels):
    seen = picture(card(quarters(texels)), 64)
    for colour, lit in zip(seen, ([1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0]), strict=True):
        np.testing.assert_array_equal(colour > 100, np.array(lit, dtype=bool))


def test_a_pixel_of_many_texels_shows_their_mean():
    rows, columns = np.indices((512, 512))
    fine = np.repeat((255 * ((rows + columns) % 2)).astype(np.uint8)[..., None], 3, axis=2)
    seen = picture(card(fine), 32)
    assert np.ptp(seen) <= 2
    assert 100 < seen.mean() < 140


def test_what_no_face_uses_takes_no_part_in_a_mean():
    image = np.zeros((256, 256, 3), dtype=np.uint8)
    image[100:110, 100:110] = 200
    textured = card(image)
    uv = (100 + 10 * textured.uv) / 256
    uv[..., 1] = 1 - (110 - 10 * textured.uv[..., 1]) / 256
    used = TexturedMesh(textured.mesh, uv.astype(np.float32), textured.texture, textured.rgb, textured.images)
    texture = Texture.of(used)
    seen = texture.at(np.array([0, 1]), np.full((2, 3), 1 / 3), np.full(2, SIDE / 4))
    assert (seen > 0.75).all()


def test_a_texture_of_other_faces_is_refused():
    textured = card(quarters(8))
    with pytest.raises(GeometryError, match="textures have 1 faces"):
        Surface(textured.mesh.vertices, textured.mesh.faces[:1], np.ones(3), 0, Texture.of(textured))
