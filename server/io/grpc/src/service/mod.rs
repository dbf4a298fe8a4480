//! The four services as tonic calls them: they read requests and write responses.

mod run;

use crate::{
    context::ServiceContext,
    control::Control,
    host::Host,
    limits::Limits,
    outbound::{Frames, outbound},
    play_stream::PlayStream,
    refusal::{Failure, Refusal, call_host},
    unary, wire,
};
use avln_proto::v1::{
    self, Reason,
    info_service_server::{InfoService, InfoServiceServer},
    play_service_server::{PlayService, PlayServiceServer},
    run_service_server::RunServiceServer,
};
use tonic::{Request, Response, Status, Streaming, metadata::MetadataMap, service::Routes};
use tonic_health::server::HealthReporter;

/// Creates all services, with health and reflection, and the reporter that sets the health.
pub(crate) async fn routes<H: Host>(
    context: &ServiceContext<H>,
) -> Result<(Routes, HealthReporter), tonic_reflection::server::Error> {
    let Limits { decode_bytes, encode_bytes, .. } = *context.limits;
    let info = InfoServiceServer::new(InfoCalls(context.clone())).max_decoding_message_size(decode_bytes);
    let run = RunServiceServer::new(run::RunCalls(context.clone())).max_decoding_message_size(decode_bytes);
    let play = PlayServiceServer::new(PlayCalls(context.clone()))
        .max_decoding_message_size(decode_bytes)
        .max_encoding_message_size(encode_bytes);
    let (reporter, health) = tonic_health::server::health_reporter();
    set_health::<H>(&reporter, true).await;
    let reflection = tonic_reflection::server::Builder::configure()
        .register_encoded_file_descriptor_set(avln_proto::FILE_DESCRIPTOR_SET)
        .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
        .build_v1()?;
    let routes =
        Routes::new(health).add_service(reflection).add_service(info).add_service(run).add_service(play);
    Ok((routes.prepare(), reporter))
}

/// Sets the health of server and services.
pub(crate) async fn set_health<H: Host>(reporter: &HealthReporter, up: bool) {
    use tonic::server::NamedService;
    use tonic_health::ServingStatus::{NotServing, Serving};
    let status = if up { Serving } else { NotServing };
    let names = [
        "",
        InfoServiceServer::<InfoCalls<H>>::NAME,
        RunServiceServer::<run::RunCalls<H>>::NAME,
        PlayServiceServer::<PlayCalls<H>>::NAME,
    ];
    for name in names {
        reporter.set_service_status(name, status).await;
    }
}

/// Returns a call's bearer token.
fn bearer(metadata: &MetadataMap) -> Result<String, Refusal> {
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

/// Info service: public information.
struct InfoCalls<H: Host>(ServiceContext<H>);

#[tonic::async_trait]
impl<H: Host> InfoService for InfoCalls<H> {
    async fn get_server_info(
        &self,
        _: Request<v1::GetServerInfoRequest>,
    ) -> Result<Response<v1::GetServerInfoResponse>, Status> {
        let ServiceContext { host, limits, registry, .. } = &self.0;
        let draining =
            registry.is_shut() || host.control().is_some_and(|control| control.draining().is_some());
        let notice = host.control().map(Control::announcement).unwrap_or_default();
        Ok(Response::new(wire::server_info(host.info(), limits, draining, notice)))
    }

    async fn list_phases(
        &self,
        request: Request<v1::ListPhasesRequest>,
    ) -> Result<Response<v1::ListPhasesResponse>, Status> {
        let host = self.0.host.clone();
        let token = match request.metadata().contains_key("authorization") {
            true => Some(bearer(request.metadata()).map_err(Failure::from)?),
            false => None,
        };
        let phases = call_host("list phases", async move {
            let account = match token {
                Some(token) => Some(host.account(&token).await?),
                None => None,
            };
            host.phases(account.as_ref()).await
        });
        let phases = phases.await?;
        let phases = phases.into_iter().map(wire::phase).collect();
        Ok(Response::new(v1::ListPhasesResponse { phases }))
    }
}

/// Play service: streams and unary calls.
struct PlayCalls<H: Host>(ServiceContext<H>);

#[tonic::async_trait]
impl<H: Host> PlayService for PlayCalls<H> {
    type PlayStream = Frames;

    async fn play(
        &self,
        request: Request<Streaming<v1::PlayRequest>>,
    ) -> Result<Response<Self::PlayStream>, Status> {
        let context = self.0.clone();
        let token = bearer(request.metadata()).map_err(Failure::from)?;
        context.registry.check_open().map_err(Failure::from)?;
        let open = context.any_run(&token).await?;
        // Two frames per slot: an observation and the end of its episode.
        let (out, frames) = outbound(2 * open.slot_limit() as usize, context.limits.reader_stall);
        let stream = PlayStream { context, token, inbound: request.into_inner(), out };
        // In a task, so that episodes are stored even if the connection is cut.
        tokio::spawn(stream.run());
        Ok(Response::new(frames))
    }

    async fn reset(&self, request: Request<v1::ResetRequest>) -> Result<Response<v1::ResetResponse>, Status> {
        let token = bearer(request.metadata()).map_err(Failure::from)?;
        Ok(Response::new(unary::reset(&self.0, &token, request.into_inner()).await?))
    }

    async fn step(&self, request: Request<v1::StepRequest>) -> Result<Response<v1::StepResponse>, Status> {
        let token = bearer(request.metadata()).map_err(Failure::from)?;
        Ok(Response::new(unary::step(&self.0, &token, request.into_inner()).await?))
    }

    async fn end(&self, request: Request<v1::EndRequest>) -> Result<Response<v1::EndResponse>, Status> {
        let token = bearer(request.metadata()).map_err(Failure::from)?;
        Ok(Response::new(unary::end(&self.0, &token, request.into_inner()).await?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_bearer_tokens_pass() {
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
