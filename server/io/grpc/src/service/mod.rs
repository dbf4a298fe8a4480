//! The four services, as the transport calls them: they read, ask and answer; rules live elsewhere.

mod info;
mod play;
mod run;

use crate::{door::Door, limits::Limits};
use avln_proto::v1::{
    info_service_server::InfoServiceServer, play_service_server::PlayServiceServer,
    run_service_server::RunServiceServer,
};
use std::time::Duration;
use tonic::service::Routes;
use tonic_health::server::HealthReporter;

/// How often a watched run is looked at.
const WATCH_INTERVAL: Duration = Duration::from_secs(1);

/// All services with their size limits, health and reflection among them; the reporter switches health.
pub(crate) async fn routes(door: &Door) -> Result<(Routes, HealthReporter), tonic_reflection::server::Error> {
    let Limits { decode_bytes, encode_bytes, .. } = *door.limits;
    let info = InfoServiceServer::new(info::Info(door.clone())).max_decoding_message_size(decode_bytes);
    let run = RunServiceServer::new(run::Runs(door.clone())).max_decoding_message_size(decode_bytes);
    let play = PlayServiceServer::new(play::Plays(door.clone()))
        .max_decoding_message_size(decode_bytes)
        .max_encoding_message_size(encode_bytes);
    let (reporter, health) = tonic_health::server::health_reporter();
    set_health(&reporter, true).await;
    let reflection = tonic_reflection::server::Builder::configure()
        .register_encoded_file_descriptor_set(avln_proto::FILE_DESCRIPTOR_SET)
        .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
        .build_v1()?;
    let routes =
        Routes::new(health).add_service(reflection).add_service(info).add_service(run).add_service(play);
    Ok((routes.prepare(), reporter))
}

/// Reports every service, and the server as a whole, as up or not.
pub(crate) async fn set_health(reporter: &HealthReporter, up: bool) {
    use tonic::server::NamedService;
    use tonic_health::ServingStatus::{NotServing, Serving};
    let status = if up { Serving } else { NotServing };
    let names = [
        "",
        InfoServiceServer::<info::Info>::NAME,
        RunServiceServer::<run::Runs>::NAME,
        PlayServiceServer::<play::Plays>::NAME,
    ];
    for name in names {
        reporter.set_service_status(name, status).await;
    }
}
