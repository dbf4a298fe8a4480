"""RGB, depth and ids by OpenGL on Mesa's llvmpipe, a stand-in for Habitat-sim without a GPU, on a dump of the peers bench.

    apt-get install libgl1-mesa-dri libegl1 libegl-mesa0
    pip install numpy moderngl
    python3 benches/llvmpipe.py FOLDER

One draw call a material, textures with mip maps, three attachments read back. Seconds are processor time of all threads.
"""

import os
import sys
import time

os.environ.update(LP_NUM_THREADS="1", LIBGL_ALWAYS_SOFTWARE="1", GALLIUM_DRIVER="llvmpipe",
                  EGL_PLATFORM="surfaceless")

from dumped import Scene, folder_argument, np, report

try:
    import moderngl
except ImportError:
    sys.exit("moderngl is missing: pip install moderngl")

ROUNDS = 5
NEAR_M, FAR_M = 0.01, 1000.0

VERTEX = """
#version 330
uniform vec3 eye, right, up, ahead;
uniform vec2 lens, planes;
in vec3 position;
in vec2 uv;
in vec3 color;
in uint instance;
out vec2 at;
out vec3 tint;
out float along;
flat out uint id;
void main() {
    vec3 offset = position - eye;
    along = dot(offset, ahead);
    float z = (along * (planes.y + planes.x) - 2.0 * planes.y * planes.x) / (planes.y - planes.x);
    gl_Position = vec4(dot(offset, right) / lens.x, dot(offset, up) / lens.y, z, along);
    at = uv;
    tint = color;
    id = instance;
}
"""

FRAGMENT = """
#version 330
uniform sampler2D picture;
uniform vec4 base;
uniform float cutoff;
in vec2 at;
in vec3 tint;
in float along;
flat in uint id;
layout(location = 0) out vec4 rgb;
layout(location = 1) out float depth;
layout(location = 2) out uint number;
void main() {
    vec4 texel = texture(picture, at) * base;
    if (texel.a < cutoff) discard;
    rgb = vec4(texel.rgb * tint, 1.0);
    depth = along;
    number = id;
}
"""


class Painter:
    """A scene in OpenGL."""

    def __init__(self, scene):
        try:
            self.gl = moderngl.create_context(standalone=True, backend="egl")
        except Exception as error:
            sys.exit(f"no OpenGL ({error}): apt-get install libgl1-mesa-dri libegl1 libegl-mesa0")
        self.program = self.gl.program(vertex_shader=VERTEX, fragment_shader=FRAGMENT)
        self.pictures = [self.picture(size, scene.texture(index)) for index, size in enumerate(scene.sizes)]
        self.white = self.picture((1, 1), b"\xff" * 4)
        self.draws = self.buffers(scene)
        size = (scene.side, scene.side)
        self.colors = self.gl.texture(size, 4)
        self.depths = self.gl.texture(size, 1, dtype="f4")
        self.ids = self.gl.texture(size, 1, dtype="u4")
        self.target = self.gl.framebuffer([self.colors, self.depths, self.ids], self.gl.depth_renderbuffer(size))

    def picture(self, size, pixels):
        texture = self.gl.texture(tuple(size), 4, pixels)
        texture.build_mipmaps()
        texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
        return texture

    def buffers(self, scene):
        """One vertex array a material. A corner that several instances share is there once for each."""
        pairs = scene.triangles.astype("u8") << 32 | scene.instance_of[:, None]
        unique, indices = np.unique(pairs.ravel(), return_inverse=True)
        corners, instances = (unique >> 32).astype("u4"), (unique & 0xFFFFFFFF).astype("u4")
        indices = indices.reshape(-1, 3).astype("u4")
        vertices = [
            (self.gl.buffer(scene.positions[corners].tobytes()), "3f", "position"),
            (self.gl.buffer(scene.uvs[corners].tobytes()), "2f", "uv"),
            (self.gl.buffer(scene.colors[corners].tobytes()), "3f1", "color"),
            (self.gl.buffer(instances.tobytes()), "1u", "instance"),
        ]
        draws = []
        for number in np.unique(scene.material_of):
            material = scene.materials[number]
            buffer = self.gl.buffer(indices[scene.material_of == number].tobytes())
            array = self.gl.vertex_array(self.program, vertices, buffer)
            texture = self.white if material["texture"] is None else self.pictures[material["texture"]]
            cutoff = 0.0 if material["cutoff"] is None else material["cutoff"] / 255
            base = [channel / 255 for channel in material["color"]]
            draws.append((array, texture, base[:3] + [1.0 if material["cutoff"] is None else base[3]], cutoff))
        return draws

    def draw(self, camera):
        """Colours, depth and ids, the first row on top."""
        eye, right, up, ahead = camera[0:3], camera[3:6], camera[6:9], camera[9:12]
        for name, value in (("eye", eye), ("right", right), ("up", up), ("ahead", ahead)):
            self.program[name].value = tuple(float(v) for v in value)
        self.program["lens"].value = (float(camera[12]), float(camera[12]))
        self.program["planes"].value = (NEAR_M, FAR_M)
        self.target.use()
        self.gl.enable_only(moderngl.DEPTH_TEST)
        self.target.clear()
        self.target.color_mask = ((True,) * 4,) * 3
        for array, texture, base, cutoff in self.draws:
            texture.use(0)
            self.program["base"].value = tuple(base)
            self.program["cutoff"].value = cutoff
            array.render()
        return self.colors.read(), self.depths.read(), self.ids.read()


def main():
    scene = Scene(folder_argument())
    painter = Painter(scene)
    print(f"{len(scene.triangles)} triangles, {len(painter.draws)} draw calls, {painter.gl.info['GL_RENDERER']}")
    fastest, depth_differs, id_differs = np.full(scene.count, np.inf), 0, 0
    for turn in range(ROUNDS):
        for index, camera in enumerate(scene.cameras):
            start = time.process_time()
            _, depth, ids = painter.draw(camera)
            fastest[index] = min(fastest[index], time.process_time() - start)
            if turn == 0:
                flip = lambda read, kind: np.frombuffer(read, kind).reshape(scene.side, -1)[::-1].ravel()
                depth, ids = flip(depth, "<f4"), flip(ids, "<u4")
                depth_differs += int(np.sum(np.abs(depth - scene.depth[index]) > 1e-3 * np.maximum(depth, 0.1)))
                id_differs += int(np.sum(ids != scene.ids[index]))
    report("llvmpipe, RGB, depth and ids, processor time", scene, fastest)
    pixels = scene.side * scene.side * scene.count
    print(f"    depth of {depth_differs} and ids of {id_differs} of {pixels} pixels differ")


main()
