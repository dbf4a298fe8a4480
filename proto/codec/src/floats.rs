use bytes::Bytes;

/// The bytes of numbers as `RAW` has them, little-endian: moved, not copied, where the machine keeps them so.
pub fn raw_floats(values: Vec<f32>) -> Bytes {
    struct Owner(Vec<f32>);
    impl AsRef<[u8]> for Owner {
        fn as_ref(&self) -> &[u8] {
            bytemuck::cast_slice(&self.0)
        }
    }
    if cfg!(target_endian = "little") {
        return Bytes::from_owner(Owner(values));
    }
    copy(&values)
}

/// The bytes of numbers, little-endian.
pub(crate) fn copy(values: &[f32]) -> Bytes {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// The numbers behind little-endian bytes, as many as are whole.
pub(crate) fn from_bytes(bytes: &[u8]) -> Vec<f32> {
    let words = bytes.as_chunks().0;
    words.iter().map(|word| f32::from_le_bytes(*word)).collect()
}
