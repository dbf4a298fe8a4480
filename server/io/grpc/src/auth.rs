use crate::{limits::Limits, refusal::Refusal};
use avln_proto::v1::Reason;
use tonic::metadata::MetadataMap;

/// The bearer token of a call.
pub(crate) fn bearer(metadata: &MetadataMap) -> Result<String, Refusal> {
    let Some(value) = metadata.get("authorization") else {
        let message = "this call needs the metadata 'authorization: Bearer <token>'";
        return Err(Refusal::new(Reason::TokenMissing, message));
    };
    let token = value.to_str().ok().and_then(|text| text.strip_prefix("Bearer ")).map(str::trim);
    match token {
        Some(token) if (1..=Limits::MAX_TOKEN_BYTES).contains(&token.len()) => Ok(token.to_owned()),
        _ => {
            let limit = Limits::MAX_TOKEN_BYTES;
            let message = format!("authorization is not 'Bearer ' and a token of 1 to {limit} bytes");
            Err(Refusal::new(Reason::TokenMalformed, message))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_bearer_token_passes() {
        let read = |value: Option<&str>| {
            let mut metadata = MetadataMap::new();
            if let Some(value) = value {
                metadata.insert("authorization", value.parse().unwrap());
            }
            bearer(&metadata).map_err(|refusal| refusal.reason)
        };
        assert_eq!(read(Some("Bearer abc")), Ok("abc".to_owned()));
        assert_eq!(read(None), Err(Reason::TokenMissing));
        let long = format!("Bearer {}", "x".repeat(Limits::MAX_TOKEN_BYTES + 1));
        for wrong in ["abc", "Basic abc", "Bearer ", "Bearer", &long] {
            assert_eq!(read(Some(wrong)), Err(Reason::TokenMalformed), "{wrong}");
        }
    }
}
