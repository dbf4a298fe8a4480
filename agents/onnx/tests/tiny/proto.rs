//! Just enough of ONNX's format (onnx.proto3) to write down a model of two operators.

/// A field that holds bytes: a message, text or packed numbers.
fn field(number: u8, bytes: &[u8]) -> Vec<u8> {
    let mut all = vec![number << 3 | 2];
    all.extend(varint(bytes.len() as u64));
    all.extend_from_slice(bytes);
    all
}

fn number(field: u8, value: u64) -> Vec<u8> {
    let mut all = vec![field << 3];
    all.extend(varint(value));
    all
}

fn varint(mut value: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    while value > 0x7f {
        bytes.push(value as u8 & 0x7f | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
    bytes
}

/// An operator of a graph.
pub(crate) fn node(operator: &str, inputs: &[&str], output: &str) -> Vec<u8> {
    let inputs = inputs.iter().flat_map(|input| field(1, input.as_bytes()));
    let node: Vec<u8> =
        inputs.chain(field(2, output.as_bytes())).chain(field(4, operator.as_bytes())).collect();
    field(1, &node)
}

/// Constant numbers of a graph.
pub(crate) fn floats(name: &str, shape: &[u64], values: &[f32]) -> Vec<u8> {
    const FLOAT: u64 = 1;
    let raw: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    tensor(name, shape, FLOAT, &raw)
}

/// Constant whole numbers of a graph.
pub(crate) fn wholes(name: &str, values: &[i64]) -> Vec<u8> {
    const INT64: u64 = 7;
    let raw: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    tensor(name, &[values.len() as u64], INT64, &raw)
}

fn tensor(name: &str, shape: &[u64], kind: u64, raw: &[u8]) -> Vec<u8> {
    let shape = shape.iter().flat_map(|&side| number(1, side));
    let tensor: Vec<u8> =
        shape.chain(number(2, kind)).chain(field(8, name.as_bytes())).chain(field(9, raw)).collect();
    field(5, &tensor)
}

/// A model that takes `picture`, 1 x 3 x `side` x `side`, and gives outputs of these names and shapes.
pub(crate) fn model(side: u64, parts: &[Vec<u8>], outputs: &[(&str, &[u64])]) -> Vec<u8> {
    let mut graph: Vec<u8> = parts.concat();
    graph.extend(field(2, b"tiny"));
    graph.extend(field(11, &value("picture", &[1, 3, side, side])));
    outputs.iter().for_each(|(name, shape)| graph.extend(field(12, &value(name, shape))));
    let opset = [field(1, b""), number(2, 13)].concat();
    [number(1, 8), field(7, &graph), field(8, &opset)].concat()
}

fn value(name: &str, shape: &[u64]) -> Vec<u8> {
    let sides: Vec<u8> = shape.iter().flat_map(|&side| field(1, &number(1, side))).collect();
    let tensor = [number(1, 1), field(2, &sides)].concat();
    [field(1, name.as_bytes()), field(2, &field(1, &tensor))].concat()
}
