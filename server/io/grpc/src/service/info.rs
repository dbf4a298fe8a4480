use crate::{
    auth::bearer,
    control::Control,
    door::Door,
    refusal::{Failure, ask},
    wire,
};
use avln_proto::v1::{self, info_service_server::InfoService};
use tonic::{Request, Response, Status};

/// What anyone may know.
#[derive(Clone)]
pub(crate) struct Info(pub(crate) Door);

#[tonic::async_trait]
impl InfoService for Info {
    async fn get_server_info(
        &self,
        _: Request<v1::GetServerInfoRequest>,
    ) -> Result<Response<v1::GetServerInfoResponse>, Status> {
        let Door { host, limits, gate, .. } = &self.0;
        let draining = gate.is_shut() || host.control().is_some_and(|control| control.draining().is_some());
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
        let phases = ask("list phases", async move {
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
