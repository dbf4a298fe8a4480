//! The run at the person's pace, and the messages to the page: text length, JSON text, then raw images and sound.

use avln_client::{
    Action, Episode, EpisodeEnd, Error, Feedback, GoalCue, Image, Observation, Play, Progress, RunSummary,
    TaskSpec,
};
use avln_kit::run::OnEnd;
use serde_json::{Value, json};
use tokio::sync::{mpsc, oneshot};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PageRequest {
    /// Report the state.
    Look,
    /// Take a step.
    Act(Action),
    /// Begin the next episode.
    Next,
}

/// A request with a reply channel. The reply to a closed page is lost.
#[derive(Debug)]
pub(crate) struct PendingRequest {
    pub(crate) request: PageRequest,
    pub(crate) answer: oneshot::Sender<Vec<u8>>,
}

/// Plays a run. An episode starts, with its clock, on the person's request.
pub(crate) async fn play(
    mut play: Play,
    mut requests: mpsc::Receiver<PendingRequest>,
    on_end: OnEnd<'_>,
) -> Result<RunSummary, Error> {
    let mut last: Option<EpisodeEnd> = None;
    loop {
        let Some(next) = wait(&mut requests, &waiting(&play, last.as_ref())).await else { break };
        let task = play.task().clone();
        let Some(mut episode) = play.next_episode().await? else {
            let _ = next.send(over(last.as_ref()));
            break;
        };
        let answer = drive(&mut episode, &task, next, &mut requests).await?;
        last = episode.end().cloned();
        if let Some(end) = &last {
            on_end(end);
        }
        let _ = answer.map(|answer| answer.send(waiting(&play, last.as_ref())));
    }
    play.finish().await
}

/// Answers with `state` until the next episode is requested; `None` if the page's server has stopped.
async fn wait(
    requests: &mut mpsc::Receiver<PendingRequest>,
    state: &[u8],
) -> Option<oneshot::Sender<Vec<u8>>> {
    loop {
        let PendingRequest { request, answer } = requests.recv().await?;
        if request == PageRequest::Next {
            return Some(answer);
        }
        let _ = answer.send(state.to_vec());
    }
}

/// Plays an episode. Returns the last request's reply channel.
async fn drive(
    episode: &mut Episode<'_>,
    task: &TaskSpec,
    first: oneshot::Sender<Vec<u8>>,
    requests: &mut mpsc::Receiver<PendingRequest>,
) -> Result<Option<oneshot::Sender<Vec<u8>>>, Error> {
    let _ = first.send(playing(task, episode, true, ""));
    loop {
        let Some(PendingRequest { request, answer }) = requests.recv().await else {
            episode.abandon().await?;
            return Ok(None);
        };
        let trouble = match request {
            PageRequest::Act(action) => match episode.step(action).await {
                Ok(_) => String::new(),
                Err(refused @ Error::Refused { .. }) => refused.to_string(),
                Err(error) => return Err(error),
            },
            PageRequest::Look | PageRequest::Next => String::new(),
        };
        if episode.is_over() {
            return Ok(Some(answer));
        }
        let _ = answer.send(playing(task, episode, request == PageRequest::Look, &trouble));
    }
}

/// Encodes an episode's state, optionally with reference images.
fn playing(task: &TaskSpec, episode: &Episode<'_>, with_goals: bool, trouble: &str) -> Vec<u8> {
    let (seen, time) = (episode.observation(), episode.time_left());
    let mission = episode.mission();
    let mut told = json!({
        "state": "playing", "trouble": trouble,
        "episode": episode.ordinal(), "progress": progress(episode.progress()),
        "order": mission.order.to_string(), "goals": mission.goals.iter().map(goal).collect::<Vec<_>>(),
        "step": seen.step, "max_steps": task.max_steps,
        "remaining_steps": seen.remaining_steps, "remaining_submits": seen.remaining_submits,
        "feedback": feedback(seen.feedback), "depth_max_m": task.depth_max_m,
        "position": seen.pose.position(), "heading_rad": seen.pose.heading_rad(),
        "step_s": time.step.map(|step| step.as_secs_f64()), "bank_s": time.bank.as_secs_f64(),
    });
    let mut bytes = Vec::new();
    told["senses"] = senses(seen, &mut bytes);
    let pictures = mission.goals.iter().map(|cue| picture(cue).filter(|_| with_goals));
    told["pictures"] = pictures.map(|picture| picture.map(|image| add_image(image, &mut bytes))).collect();
    framed(&told, &bytes)
}

/// Encodes the state between episodes, with the last end.
pub(crate) fn waiting(play: &Play, last: Option<&EpisodeEnd>) -> Vec<u8> {
    framed(&json!({ "state": "waiting", "progress": progress(play.progress()), "end": last.map(end) }), &[])
}

pub(crate) fn over(last: Option<&EpisodeEnd>) -> Vec<u8> {
    framed(&json!({ "state": "over", "end": last.map(end) }), &[])
}

fn framed(told: &Value, rest: &[u8]) -> Vec<u8> {
    let text = told.to_string();
    let length = (text.len() as u32).to_le_bytes();
    [&length, text.as_bytes(), rest].concat()
}

fn progress(progress: Progress) -> Value {
    json!({ "done": progress.done, "total": progress.total })
}

fn end(end: &EpisodeEnd) -> Value {
    let metrics = end.metrics.iter().flatten().map(|metric| (metric.name.clone(), json!(metric.value)));
    let metrics: serde_json::Map<String, Value> = metrics.collect();
    json!({ "reason": end.reason.to_string(), "steps": end.steps, "metrics": metrics })
}

fn goal(cue: &GoalCue) -> Value {
    match cue {
        GoalCue::Category(text) => json!({ "kind": "category", "text": text }),
        GoalCue::Description(text) => json!({ "kind": "sentence", "text": text }),
        GoalCue::Image(_) => json!({ "kind": "picture", "text": "" }),
    }
}

fn picture(cue: &GoalCue) -> Option<&Image> {
    if let GoalCue::Image(image) = cue { Some(image) } else { None }
}

fn feedback(feedback: Feedback) -> Option<&'static str> {
    match feedback {
        Feedback::None => None,
        Feedback::Accepted => Some("counted"),
        Feedback::Verdict(true) => Some("right"),
        Feedback::Verdict(false) => Some("wrong"),
    }
}

/// Encodes the observation; appends colours, depth, left ear and right ear to `bytes`, in this order.
fn senses(seen: &Observation, bytes: &mut Vec<u8>) -> Value {
    let rgb = seen.rgb.as_ref().map(|image| add_image(image, bytes));
    let depth = seen.depth.as_ref().map(|depth| {
        add_numbers(&depth.metres, bytes);
        json!([depth.width, depth.height])
    });
    let audio = seen.audio.as_ref().map(|audio| {
        add_numbers(&audio.left, bytes);
        add_numbers(&audio.right, bytes);
        json!([audio.sample_rate_hz, audio.left.len()])
    });
    json!({ "rgb": rgb, "depth": depth, "audio": audio })
}

fn add_image(image: &Image, bytes: &mut Vec<u8>) -> Value {
    bytes.extend(&image.pixels);
    json!([image.width, image.height])
}

fn add_numbers(numbers: &[f32], bytes: &mut Vec<u8>) {
    bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_client::{Audio, DepthImage};

    #[test]
    fn raw_bytes_follow_in_order() {
        let seen = Observation {
            rgb: Some(Image { width: 1, height: 2, pixels: vec![1, 2, 3, 4, 5, 6] }),
            depth: Some(DepthImage { width: 1, height: 1, metres: vec![1.5] }),
            audio: Some(Audio { sample_rate_hz: 16_000, left: vec![0.5], right: vec![-0.5] }),
            ..Observation::default()
        };
        let mut bytes = Vec::new();
        let told = senses(&seen, &mut bytes);
        assert_eq!(told, json!({ "rgb": [1, 2], "depth": [1, 1], "audio": [16_000, 1] }));
        let expected = [
            &[1, 2, 3, 4, 5, 6][..],
            &1.5_f32.to_le_bytes(),
            &0.5_f32.to_le_bytes(),
            &(-0.5_f32).to_le_bytes(),
        ];
        assert_eq!(bytes, expected.concat());
        assert_eq!(senses(&Observation::default(), &mut bytes)["audio"], Value::Null);
    }

    #[test]
    fn text_follows_its_length() {
        let framed = framed(&json!({ "a": 1 }), &[9]);
        assert_eq!(framed, [&[7, 0, 0, 0][..], b"{\"a\":1}", &[9]].concat());
    }
}
