/// Types of fields in the compact protocol of Thrift.
const I32: u8 = 5;
const I64: u8 = 6;
const BINARY: u8 = 8;
const LIST: u8 = 9;
const STRUCT: u8 = 12;
/// Lists of so many entries say their number in a byte of its own.
const MANY: usize = 15;

/// A struct in the compact protocol of Thrift; its fields are given in the order of their numbers.
pub(super) struct Struct {
    bytes: Vec<u8>,
    last: u8,
}

impl Struct {
    pub(super) fn new() -> Self {
        Self { bytes: Vec::new(), last: 0 }
    }

    pub(super) fn i32(self, field: u8, value: i32) -> Self {
        self.number(field, I32, i64::from(value))
    }

    pub(super) fn i64(self, field: u8, value: i64) -> Self {
        self.number(field, I64, value)
    }

    pub(super) fn text(mut self, field: u8, text: &str) -> Self {
        self.begin(field, BINARY);
        push_text(&mut self.bytes, text);
        self
    }

    /// A struct that has its end.
    pub(super) fn inner(mut self, field: u8, inner: &[u8]) -> Self {
        self.begin(field, STRUCT);
        self.bytes.extend(inner);
        self
    }

    pub(super) fn structs(mut self, field: u8, structs: &[Vec<u8>]) -> Self {
        self.list(field, STRUCT, structs.len());
        structs.iter().for_each(|inner| self.bytes.extend(inner));
        self
    }

    pub(super) fn i32s(mut self, field: u8, values: &[i32]) -> Self {
        self.list(field, I32, values.len());
        values.iter().for_each(|value| push_zigzag(&mut self.bytes, i64::from(*value)));
        self
    }

    pub(super) fn texts(mut self, field: u8, texts: &[&str]) -> Self {
        self.list(field, BINARY, texts.len());
        texts.iter().for_each(|text| push_text(&mut self.bytes, text));
        self
    }

    /// All of its bytes.
    pub(super) fn end(mut self) -> Vec<u8> {
        self.bytes.push(0);
        self.bytes
    }

    fn number(mut self, field: u8, kind: u8, value: i64) -> Self {
        self.begin(field, kind);
        push_zigzag(&mut self.bytes, value);
        self
    }

    /// Fields are told by how far their number is from the one before.
    fn begin(&mut self, field: u8, kind: u8) {
        self.bytes.push((field - self.last) << 4 | kind);
        self.last = field;
    }

    fn list(&mut self, field: u8, kind: u8, count: usize) {
        self.begin(field, LIST);
        if count < MANY {
            self.bytes.push((count as u8) << 4 | kind);
        } else {
            self.bytes.push(0xf0 | kind);
            push_varint(&mut self.bytes, count as u64);
        }
    }
}

fn push_text(bytes: &mut Vec<u8>, text: &str) {
    push_varint(bytes, text.len() as u64);
    bytes.extend(text.as_bytes());
}

/// Numbers near zero, of either sign, take few bytes.
fn push_zigzag(bytes: &mut Vec<u8>, value: i64) {
    push_varint(bytes, ((value << 1) ^ (value >> 63)) as u64);
}

/// Seven bits a byte, the lowest first.
fn push_varint(bytes: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_as_thrift_writes_them() {
        let written = |value: i64| {
            let mut bytes = Vec::new();
            push_zigzag(&mut bytes, value);
            bytes
        };
        assert_eq!(written(0), [0]);
        assert_eq!(written(-1), [1]);
        assert_eq!(written(63), [126]);
        assert_eq!(written(64), [128, 1]);
        assert_eq!(written(i64::MIN), [255, 255, 255, 255, 255, 255, 255, 255, 255, 1]);
    }

    #[test]
    fn fields_and_lists_are_as_thrift_writes_them() {
        assert_eq!(Struct::new().i32(1, 1).text(4, "ab").end(), [0x15, 2, 0x38, 2, b'a', b'b', 0]);
        let many = Struct::new().i32s(2, &[0; 20]).end();
        assert_eq!(many[..3], [0x29, 0xf5, 20]);
    }
}
