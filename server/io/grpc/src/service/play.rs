use crate::{
    auth::bearer,
    door::{Door, most_slots},
    outbound::{Frames, outbound},
    play::Stage,
    refusal::Failure,
    unary,
};
use avln_proto::v1::{self, play_service_server::PlayService};
use tonic::{Request, Response, Status, Streaming};

/// Playing episodes, by stream or call by call.
#[derive(Clone)]
pub(crate) struct Plays(pub(crate) Door);

#[tonic::async_trait]
impl PlayService for Plays {
    type PlayStream = Frames;

    async fn play(
        &self,
        request: Request<Streaming<v1::PlayRequest>>,
    ) -> Result<Response<Self::PlayStream>, Status> {
        let door = self.0.clone();
        let token = bearer(request.metadata()).map_err(Failure::from)?;
        door.gate.check_open().map_err(Failure::from)?;
        let open = door.any_run(&token).await?;
        let (out, frames) = outbound(2 * most_slots(&open) as usize, door.limits.reader_stall);
        let stage = Stage { door, token, inbound: request.into_inner(), out };
        // A task of its own: episodes are put away even when the connection is cut.
        tokio::spawn(stage.run());
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
