//! Attempts lost while the database refuses changes.

use super::*;

/// Lets the database refuse changes of episodes, or accept them again.
async fn refuse_episodes(folder: &Path, refuses: bool) {
    let database = SqliteConnectOptions::new().filename(folder.join("avln.db"));
    let mut other = SqliteConnection::connect_with(&database).await.expect("the database");
    let change = match refuses {
        true => "CREATE TRIGGER refusal BEFORE UPDATE ON episodes BEGIN SELECT RAISE(ABORT, 'no space'); END",
        false => "DROP TRIGGER refusal",
    };
    sqlx::query(change).execute(&mut other).await.expect("a change of the schema");
    other.close().await.expect("the end of it");
}

/// Time in which the server looks for episodes that it could not return.
const NEXT_LOOK: Duration = Duration::from_millis(2500);

#[tokio::test(flavor = "multi_thread")]
async fn unstored_loss_of_hanging_step_is_stored_later() {
    let (server, go_on) = hanging().await;
    let (run, mut play) = begin(&server.agents_url(), &server.token).await;
    let mut episode = play.next_episode().await.expect("an answer").expect("an episode");
    refuse_episodes(server.folder.path(), true).await;
    episode.step(Action::TurnLeft).await.expect("it learns of the end");
    assert_eq!(end_of(&episode), Some(EndReason::ServerFault));
    refuse_episodes(server.folder.path(), false).await;
    sleep(NEXT_LOOK).await;
    play_on(play).await.expect("to the end");
    let expected = expect("stopped stopped", RunState::Completed, true);
    assert_eq!(verdict(server.folder.path(), &run.id).await, expected);
    drop(go_on);
}

#[tokio::test(flavor = "multi_thread")]
async fn restart_keeps_an_announced_loss() {
    let server = server(|_| ()).await;
    let (run, mut play) = begin(&server.agents_url(), &server.token).await;
    let mut episode = play.next_episode().await.expect("an answer").expect("an episode");
    refuse_episodes(server.folder.path(), true).await;
    episode.step(Action::Stop).await.expect("it learns of the end");
    assert_eq!(end_of(&episode), Some(EndReason::ServerFault), "the result is not stored");
    drop(play);
    let server = server.reopen().await;
    refuse_episodes(server.folder.path(), false).await;
    sleep(NEXT_LOOK).await;
    let expected = expect("- -", RunState::Running, true);
    assert_eq!(
        verdict(server.folder.path(), &run.id).await,
        expected,
        "the result in the log does not count"
    );
}
