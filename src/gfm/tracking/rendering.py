"""Images of the simulated cell: tags on the object, seen by its cameras, drawn by MuJoCo.

Needs OpenGL without a display (EGL or OSMesa); which one works is found out by trying, unless
MUJOCO_GL says it. Cameras are drawn without distortion and with a principal point in the middle.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from importlib import import_module
from types import ModuleType
from typing import Any, Self, final

import mujoco
import numpy as np

from gfm.core import CommandKind, ConfigError, GfmError
from gfm.core.checks import Array
from gfm.sim.cell import OBJECT_BODY, FreeObject
from gfm.sim.sawyer import READY, sawyer_spec
from gfm.tracking.camera import Camera
from gfm.tracking.detect import Image, rim_scale, tag_image
from gfm.tracking.layout import Tag, TagLayout
from gfm.tracking.rigid import Pose

_BACKENDS = ("egl", "osmesa")
_MODULE_PX = 16
#: A tag is a sticker: so thick, and so far above the face that it is not drawn into it.
_HALF_THICKNESS_M, _ABOVE_FACE_M = 1e-5, 2e-5
#: Of no use to a detector, and slow without a graphics card.
_LEFT_OUT = ("mjRND_SHADOW", "mjRND_REFLECTION", "mjRND_HAZE", "mjRND_SKYBOX")
_PIXEL_M = 4e-6  # of the sensor; the image depends on focal length in pixels alone
_SAMPLES = 0
#: Weights of red, green and blue in brightness (ITU-R BT.601).
_BRIGHTNESS = (0.299, 0.587, 0.114)


class NoRendererError(GfmError):
    """Nothing can be drawn here."""


def tagged_spec(kind: FreeObject, layout: TagLayout, cameras: Sequence[Camera]) -> mujoco.MjSpec:
    """Returns the cell with tags on its object, and the cameras.

    Raises:
        ConfigError: a camera has distortion, pixels that are not square, or another principal
            point than the middle; or the cameras' images differ in size.
    """
    spec = sawyer_spec(command=CommandKind.POSITION, free_object=kind)
    for tag in layout.tags:
        _stick(spec, spec.body(OBJECT_BODY), tag)
    for camera in cameras:
        _mount(spec, camera)
    sizes = {camera.size_px for camera in cameras}
    if len(sizes) != 1:
        raise ConfigError(f"the cameras have images of {len(sizes)} sizes, expected one")
    spec.visual.global_.offwidth, spec.visual.global_.offheight = sizes.pop()
    spec.visual.quality.offsamples = _SAMPLES
    return spec


def _stick(spec: mujoco.MjSpec, body: mujoco.MjsBody, tag: Tag) -> None:
    """Puts a tag with its white rim on a body."""
    picture = np.repeat(tag_image(tag.id, _MODULE_PX)[..., None], 3, axis=2)
    name = f"tag_{tag.id}"
    texture = spec.add_texture(
        name=name,
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        width=picture.shape[1],
        height=picture.shape[0],
        nchannel=3,
    )
    texture.data = picture.tobytes()
    material = spec.add_material(name=name, texuniform=False, texrepeat=(1.0, 1.0))
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    half = 0.5 * rim_scale() * tag.size_m
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=(half, half, _HALF_THICKNESS_M),
        pos=tag.pose.of(np.array([0.0, 0.0, _ABOVE_FACE_M])),
        quat=tag.pose.quaternion,
        material=name,
        contype=0,
        conaffinity=0,
        mass=0.0,
    )


def _mount(spec: mujoco.MjSpec, camera: Camera) -> None:
    """Adds a camera; MuJoCo's looks along -z with y up."""
    width, height = camera.size_px
    middle = np.array([width - 1.0, height - 1.0]) / 2.0
    is_plain = not camera.distortion.any() and np.allclose(camera.centre_px, middle)
    if not is_plain or camera.focal_px[0] != camera.focal_px[1]:
        raise ConfigError(
            f"camera {camera.name!r} cannot be drawn; expected no distortion, equal focal lengths "
            f"and a principal point of {middle.tolist()}"
        )
    flipped = Pose(rotation=np.diag([1.0, -1.0, -1.0]), position=np.zeros(3))
    spec.worldbody.add_camera(
        name=camera.name,
        pos=camera.pose.position,
        quat=(camera.pose @ flipped).quaternion,
        resolution=camera.size_px,
        focal_pixel=camera.focal_px,
        sensor_size=(width * _PIXEL_M, height * _PIXEL_M),
    )


@final
class CellRenderer:
    """Draws what the cameras of the cell see; a context that frees its buffers.

    Args:
        kind: The object.
        layout: The tags on it.
        cameras: Where they really stand.

    Raises:
        NoRendererError: there is no OpenGL here.
    """

    def __init__(self, kind: FreeObject, layout: TagLayout, cameras: Sequence[Camera]) -> None:
        self._model = tagged_spec(kind, layout, cameras).compile()
        self._data = mujoco.MjData(self._model)
        self._width, self._height = cameras[0].size_px
        self._gl = _gl_context(self._width, self._height)
        self._gl.make_current()
        self._context = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._scene = mujoco.MjvScene(self._model, maxgeom=self._model.ngeom + 100)
        for flag in _LEFT_OUT:
            self._scene.flags[getattr(mujoco.mjtRndFlag, flag)] = False

    def draw(self, camera: str, pose: Pose, joints: Array = READY) -> Image:
        """Returns a grey image, shape (H, W).

        Args:
            camera: Who looks.
            pose: The object in the base frame.
            joints: Of the arm, rad, shape (7,).
        """
        data, rectangle = self._data, mujoco.MjrRect(0, 0, self._width, self._height)
        data.qpos[: len(joints)], data.qpos[len(joints) :] = joints, pose.vector
        mujoco.mj_forward(self._model, data)
        eye = mujoco.MjvCamera()
        eye.type = mujoco.mjtCamera.mjCAMERA_FIXED
        eye.fixedcamid = self._model.camera(camera).id
        everything = mujoco.mjtCatBit.mjCAT_ALL
        option = mujoco.MjvOption()
        mujoco.mjv_updateScene(self._model, data, option, None, eye, everything, self._scene)
        colours = np.empty((self._height, self._width, 3), np.uint8)
        mujoco.mjr_render(rectangle, self._scene, self._context)
        mujoco.mjr_readPixels(colours, None, rectangle, self._context)
        return np.asarray(np.rint(colours[::-1] @ np.array(_BRIGHTNESS)), np.uint8)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._context.free()
        self._gl.free()


def with_pixel_noise(image: Image, noise: float, rng: np.random.Generator) -> Image:
    """Returns an image with noise of so many grey levels on every pixel."""
    noisy = image + noise * rng.standard_normal(image.shape, np.float32)
    return np.asarray(np.clip(np.rint(noisy), 0, 255), np.uint8)


def _gl_context(width: int, height: int) -> Any:  # noqa: ANN401  each backend has its own class
    chosen = os.environ.get("MUJOCO_GL")
    problems = []
    for name in (chosen,) if chosen else _BACKENDS:
        try:
            module: ModuleType = import_module(f"mujoco.{name}")
            return module.GLContext(width, height)
        except (ImportError, AttributeError, RuntimeError) as exc:
            problems.append(f"{name}: {exc}")
    raise NoRendererError(f"nothing can be drawn here: {'; '.join(problems)}")
