//! Runs, phases, health, reflection, and malicious connections.

use crate::common::{
    ACCOUNT, Agent, LOOKING, ORGANISER, Plan, RUN, RUN_TOKEN, TestServer, authorised, channel, reason, soon,
};
use avln_challenge::MethodType;
use avln_episode::{EndReason, Order};
use avln_grpc::Limits;
use avln_proto::v1::{self, info_service_client::InfoServiceClient, run_service_client::RunServiceClient};
use std::time::{Duration, Instant};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::TcpStream,
};
use tonic::{Code, Request};
use tonic_health::pb::{
    HealthCheckRequest, health_check_response::ServingStatus, health_client::HealthClient,
};

fn start_request(phase: &str) -> v1::StartRunRequest {
    let method = v1::MethodInfo {
        name: " walker ".into(),
        version: "2".into(),
        description: "walks\nand stops".into(),
        code_url: "https://example.org/walker".into(),
        weights_licence: "MIT".into(),
        method_type: v1::MethodType::Imitation.into(),
        ..v1::MethodInfo::default()
    };
    v1::StartRunRequest { phase: phase.into(), method: Some(method), ..v1::StartRunRequest::default() }
}

#[tokio::test]
async fn server_information_is_public() {
    let server = TestServer::open(Plan::plain(2)).await;
    let mut client = InfoServiceClient::new(channel(&server).await);
    let info = client.get_server_info(v1::GetServerInfoRequest {}).await.unwrap().into_inner();
    assert_eq!((info.name.as_str(), info.state()), ("toy", v1::ServerState::Up));
    assert_eq!(info.max_request_bytes as usize, Limits::default().decode_bytes);
    let phases = client.list_phases(v1::ListPhasesRequest {}).await.unwrap().into_inner().phases;
    assert_eq!((phases[0].id.as_str(), phases[0].episodes, phases[0].sensors.len()), ("practice", 2, 3));
    assert_eq!((phases[0].results(), phases[0].commitment.as_str()), (v1::Visibility::Team, "c0ffee"));
    let list = |token| authorised(v1::ListPhasesRequest {}, token);
    let own = client.list_phases(list(ACCOUNT)).await.unwrap().into_inner().phases;
    assert_eq!((phases[0].title.as_str(), own[0].title.as_str()), ("Practice", "Practice of the team"));
    assert_eq!(reason(&client.list_phases(list("guess")).await.unwrap_err()), "TOKEN_MALFORMED");
}

#[tokio::test]
async fn calls_above_the_rate_wait() {
    let server =
        TestServer::with_limits(Plan::plain(1), Limits { calls_per_s: 10, ..Limits::default() }).await;
    let mut client = InfoServiceClient::new(channel(&server).await);
    let begun = Instant::now();
    for _ in 0..15 {
        client.get_server_info(v1::GetServerInfoRequest {}).await.unwrap();
    }
    assert!(begun.elapsed() >= Duration::from_millis(500), "{:?}", begun.elapsed());
}

#[tokio::test]
async fn all_calls_report_the_same_quota() {
    let server = TestServer::open(Plan::plain(1)).await;
    let mut client = RunServiceClient::new(channel(&server).await);
    let ask = authorised(v1::GetQuotaRequest { phase: "practice".into() }, LOOKING);
    let told = client.get_quota(ask).await.unwrap().into_inner().quotas;
    let started =
        client.start_run(authorised(start_request("practice"), ACCOUNT)).await.unwrap().into_inner();
    assert_eq!(started.quota.as_ref(), told.first());
    let quota = &told[0];
    assert_eq!((quota.window(), quota.limit, quota.used), (v1::QuotaWindow::Day, Some(3), 2));
    assert_eq!((quota.remaining, quota.next_increase_unix_s), (Some(1), 172_800));
    assert_eq!(quota.charges[0].reason, "it was played");
    let run = started.run.unwrap();
    assert_eq!((run.charged, run.charge_reason.as_str()), (true, "it is open"));
}

#[tokio::test]
async fn tokens_are_limited_to_their_scope() {
    let server = TestServer::open(Plan::plain(1)).await;
    let mut client = RunServiceClient::new(channel(&server).await);
    for token in [LOOKING, ORGANISER] {
        let start = client.start_run(authorised(start_request("practice"), token)).await.unwrap_err();
        let cancel = authorised(v1::CancelRunRequest { run: RUN.into() }, token);
        let cancel = client.cancel_run(cancel).await.unwrap_err();
        assert_eq!([reason(&start), reason(&cancel)], ["TOKEN_SCOPE", "TOKEN_SCOPE"], "{token}");
    }
    let get = |token| authorised(v1::GetRunRequest { run: RUN.into() }, token);
    assert!(client.get_run(get(LOOKING)).await.is_ok());
    assert_eq!(reason(&client.get_run(get(ORGANISER)).await.unwrap_err()), "TOKEN_SCOPE");
    let who = client.who_am_i(authorised(v1::WhoAmIRequest {}, LOOKING)).await.unwrap().into_inner();
    assert_eq!(who.scope(), v1::TokenScope::ReadOnly);
    assert_eq!((who.token_name.as_str(), who.expires_unix_s), ("laptop", 77));
}

#[tokio::test]
async fn a_team_starts_and_lists_its_runs() {
    let server = TestServer::open(Plan::plain(2)).await;
    let mut client = RunServiceClient::new(channel(&server).await);
    let started =
        client.start_run(authorised(start_request("practice"), ACCOUNT)).await.unwrap().into_inner();
    assert_eq!((started.run_token.as_str(), started.run.unwrap().id.as_str()), (RUN_TOKEN, RUN));
    let request = &server.host.requests()[0];
    assert_eq!((request.method.name.as_str(), request.order), ("walker", Order::Unordered));
    assert_eq!(request.method.description, "walks\nand stops");
    assert_eq!(request.method.code_url, "https://example.org/walker");
    assert_eq!((request.method.weights_licence.as_str(), request.method.paper_url.as_str()), ("MIT", ""));
    assert_eq!(request.method.method_type, Some(MethodType::Imitation));

    let get = authorised(v1::GetRunRequest { run: RUN.into() }, ACCOUNT);
    let run = client.get_run(get).await.unwrap().into_inner().run.unwrap();
    assert_eq!(run.method.as_ref().unwrap().method_type(), v1::MethodType::Rl);
    let progress = run.progress.unwrap();
    assert_eq!((run.state(), progress.total, progress.in_flight), (v1::RunState::Running, 2, 2));

    let mut page = v1::ListRunsRequest { page_size: 2, ..v1::ListRunsRequest::default() };
    let first = client.list_runs(authorised(page.clone(), ACCOUNT)).await.unwrap().into_inner();
    assert_eq!(first.runs.iter().map(|run| run.id.as_str()).collect::<Vec<_>>(), ["run_c", "run_b"]);
    page.page_token = first.next_page_token;
    let rest = client.list_runs(authorised(page, ACCOUNT)).await.unwrap().into_inner();
    assert_eq!((rest.runs[0].id.as_str(), rest.next_page_token.as_str()), ("run_a", ""));

    let who = client.who_am_i(authorised(v1::WhoAmIRequest {}, ACCOUNT)).await.unwrap().into_inner();
    assert_eq!(who.team, "red");
}

#[tokio::test]
async fn unknown_method_types_count_as_undeclared() {
    let server = TestServer::open(Plan::plain(1)).await;
    let mut client = RunServiceClient::new(channel(&server).await);
    for number in [0, 99] {
        let mut request = start_request("practice");
        request.method.iter_mut().for_each(|method| method.method_type = number);
        client.start_run(authorised(request, ACCOUNT)).await.unwrap();
    }
    let stored: Vec<_> = server.host.requests().iter().map(|request| request.method.method_type).collect();
    assert_eq!(stored, [None, None]);
}

#[tokio::test]
async fn bad_requests_are_refused_with_their_problem() {
    let server = TestServer::open(Plan::plain(1)).await;
    let mut client = RunServiceClient::new(channel(&server).await);
    let nameless = v1::StartRunRequest { method: None, ..start_request("practice") };
    let with = |change: fn(&mut v1::MethodInfo)| {
        let mut request = start_request("practice");
        request.method.iter_mut().for_each(change);
        authorised(request, ACCOUNT)
    };
    let cases = [
        (Request::new(start_request("practice")), "TOKEN_MISSING"),
        (authorised(start_request("practice"), "guess"), "TOKEN_MALFORMED"),
        (authorised(start_request("secret"), ACCOUNT), "PHASE_UNKNOWN"),
        (authorised(start_request(""), ACCOUNT), "BAD_REQUEST"),
        (authorised(nameless, ACCOUNT), "BAD_REQUEST"),
        (with(|method| method.description = "x".repeat(2001)), "BAD_REQUEST"),
        (with(|method| method.code_url = "javascript:alert(1)".into()), "BAD_REQUEST"),
        (with(|method| method.paper_url = format!("https://{}", "x".repeat(500))), "BAD_REQUEST"),
        (with(|method| method.external_data = "a\tb".into()), "BAD_REQUEST"),
        (with(|method| method.name = "reklaw\u{202e}".into()), "BAD_REQUEST"),
        (with(|method| method.version = "\u{200b}".into()), "BAD_REQUEST"),
    ];
    for (request, word) in cases {
        assert_eq!(reason(&client.start_run(request).await.unwrap_err()), word);
    }
    let unknown = authorised(v1::GetRunRequest { run: "run_other".into() }, ACCOUNT);
    let status = client.get_run(unknown).await.unwrap_err();
    assert_eq!((status.code(), reason(&status).as_str()), (Code::NotFound, "RUN_UNKNOWN"));
}

#[tokio::test]
async fn a_panic_of_the_host_reveals_no_detail() {
    let server = TestServer::open(Plan::plain(1)).await;
    let mut client = RunServiceClient::new(channel(&server).await);
    let status = client.who_am_i(authorised(v1::WhoAmIRequest {}, "break")).await.unwrap_err();
    assert_eq!((status.code(), reason(&status).as_str()), (Code::Internal, "INTERNAL"));
    assert!(status.message().contains("inc_") && !status.message().contains("secret"), "{status:?}");
    server.still_serves().await;
}

#[tokio::test]
async fn cancelling_a_run_ends_its_stream() {
    let server = TestServer::open(Plan::plain(2)).await;
    let mut agent = Agent::enter(&server, 1).await;
    agent.ready(0).await;
    let mut client = RunServiceClient::new(channel(&server).await);
    let cancel = authorised(v1::CancelRunRequest { run: RUN.into() }, ACCOUNT);
    let run = client.cancel_run(cancel).await.unwrap().into_inner().run.unwrap();
    assert_eq!(run.state(), v1::RunState::Cancelled);
    assert_eq!(server.host.ends(1).await, [Some(EndReason::Abandoned)]);
    assert_eq!(agent.episode_end().await.reason(), v1::EndReason::Abandoned);
    assert_eq!(agent.fault().await.reason(), v1::Reason::RunOver);
}

#[tokio::test]
async fn a_watched_run_is_reported_until_its_end() {
    let limits = Limits { max_watchers: 1, ..Limits::default() };
    let server = TestServer::with_limits(Plan::plain(1), limits).await;
    let mut client = RunServiceClient::new(channel(&server).await);
    let watch = |run: &str| authorised(v1::WatchRunRequest { run: run.into() }, ACCOUNT);
    let mut updates = client.watch_run(watch(RUN)).await.unwrap().into_inner();
    let first = soon(updates.message()).await.unwrap().unwrap().run.unwrap();
    assert_eq!(first.state(), v1::RunState::Running);
    assert_eq!(reason(&client.watch_run(watch(RUN)).await.unwrap_err()), "NO_CAPACITY");
    let mut agent = Agent::enter(&server, 1).await;
    agent.goodbye().await;
    agent.run_end().await;
    let last = soon(updates.message()).await.unwrap().unwrap().run.unwrap();
    assert_eq!(last.state(), v1::RunState::Cancelled, "an episode was left");
    assert_eq!(soon(updates.message()).await.unwrap(), None);
    assert_eq!(reason(&client.watch_run(watch("run_other")).await.unwrap_err()), "RUN_UNKNOWN");
}

#[tokio::test]
async fn health_is_reported_until_the_server_stops() {
    let server = TestServer::open(Plan::plain(1)).await;
    let mut client = HealthClient::new(channel(&server).await);
    for service in ["", "avln.v1.PlayService", "avln.v1.RunService", "avln.v1.InfoService"] {
        let request = HealthCheckRequest { service: service.into() };
        let answer = client.check(request).await.unwrap().into_inner();
        assert_eq!(answer.status(), ServingStatus::Serving, "{service}");
    }
    let unknown = client.check(HealthCheckRequest { service: "avln.v9.Nothing".into() }).await.unwrap_err();
    assert_eq!(unknown.code(), Code::NotFound);
    let watch = HealthCheckRequest { service: "avln.v1.PlayService".into() };
    let mut watched = client.watch(watch).await.unwrap().into_inner();
    assert_eq!(watched.message().await.unwrap().unwrap().status(), ServingStatus::Serving);
    let closed = server.close();
    assert_eq!(soon(watched.message()).await.unwrap().unwrap().status(), ServingStatus::NotServing);
    drop((watched, client));
    soon(closed).await.unwrap();
}

#[tokio::test]
async fn reflection_names_the_services() {
    use tonic_reflection::pb::v1::{
        ServerReflectionRequest, server_reflection_client::ServerReflectionClient,
        server_reflection_request::MessageRequest, server_reflection_response::MessageResponse,
    };
    let server = TestServer::open(Plan::plain(1)).await;
    let mut client = ServerReflectionClient::new(channel(&server).await);
    let ask = ServerReflectionRequest {
        host: String::new(),
        message_request: Some(MessageRequest::ListServices(String::new())),
    };
    let mut answers = client.server_reflection_info(tokio_stream::once(ask)).await.unwrap().into_inner();
    let answer = soon(answers.message()).await.unwrap().unwrap();
    let Some(MessageResponse::ListServicesResponse(list)) = answer.message_response else {
        panic!("no list")
    };
    let names: Vec<_> = list.service.into_iter().map(|service| service.name).collect();
    for name in ["avln.v1.PlayService", "avln.v1.RunService", "avln.v1.InfoService", "grpc.health.v1.Health"]
    {
        assert!(names.iter().any(|known| known == name), "{name} is not among {names:?}");
    }
}

#[tokio::test]
async fn silent_connections_are_closed_and_limited() {
    // An address may hold half of them.
    let limits = Limits { first_request: Duration::from_millis(50), max_connections: 4, ..Limits::default() };
    let server = TestServer::with_limits(Plan::plain(1), limits).await;
    let mut idle = TcpStream::connect(server.address).await.unwrap();
    let mut half = TcpStream::connect(server.address).await.unwrap();
    half.write_all(b"PRI * HTTP/2.0\r\n").await.unwrap();
    let mut third = TcpStream::connect(server.address).await.unwrap();
    for connection in [&mut third, &mut idle, &mut half] {
        let mut rest = Vec::new();
        // Both a clean end and a reset are a close by the server.
        let _ = soon(connection.read_to_end(&mut rest)).await;
    }
    server.still_serves().await;
}

#[tokio::test]
async fn nonsense_harms_only_its_connection() {
    let server = TestServer::open(Plan::plain(1)).await;
    let preface = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n".to_vec();
    let garbage = [preface, vec![0xff; 4096]].concat();
    for bytes in [b"GET / HTTP/1.1\r\nHost: x\r\n\r\n".to_vec(), garbage, vec![0; 100_000]] {
        let mut connection = TcpStream::connect(server.address).await.unwrap();
        let _ = connection.write_all(&bytes).await;
        let mut rest = Vec::new();
        let _ = soon(connection.read_to_end(&mut rest)).await;
    }
    server.still_serves().await;
}
