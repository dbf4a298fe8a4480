//! What documents, images and unit files tell people to type is what the program understands.

use avln_cli::Cli;
use avln_tests::repository::{files, root, shown, text, typed};
use clap::{Parser, error::ErrorKind};
use std::{fs, iter, mem};
use yaml_rust2::{Yaml, YamlLoader};

/// The simple commands of a line of shell, as words; comments and what is redirected are left out.
fn commands(line: &str) -> Vec<Vec<String>> {
    let mut found = vec![Vec::new()];
    let (mut word, mut quote, mut is_word) = (String::new(), None, false);
    for letter in line.chars().chain(iter::once('\n')) {
        match (letter, quote) {
            (mark, Some(open)) if mark == open => quote = None,
            (letter, Some(_)) => word.push(letter),
            ('\'' | '"', None) => (quote, is_word) = (Some(letter), true),
            ('#', None) if !is_word => break,
            (letter, None) if letter.is_whitespace() || "|&;<>()".contains(letter) => {
                let words = found.last_mut().expect("one at least");
                if mem::take(&mut is_word) {
                    words.push(mem::take(&mut word));
                }
                if "|&;<>()".contains(letter) {
                    found.push(Vec::new());
                }
            }
            (letter, None) => {
                word.push(letter);
                is_word = true;
            }
        }
    }
    found.last_mut().expect("one at least").extend(is_word.then_some(word));
    found.retain(|words| !words.is_empty());
    found
}

/// What the program is called with in a command; `None` where another is called.
fn arguments(words: &[String]) -> Option<Vec<String>> {
    let is_setting = |word: &&String| word.contains('=') && !word.starts_with('-');
    let words: Vec<_> = words.iter().skip_while(is_setting).map(String::as_str).collect();
    let is_program = |word: &str| word == "avln" || word.ends_with("/avln");
    let program = match *words.first()? {
        name if is_program(name) => 0,
        "cargo" => words.windows(2).position(|pair| pair == ["--release", "--"])? + 1,
        "sudo" if words[1..].starts_with(&["-u", "avln", "avln"]) => 3,
        "arena" | "docker" | "exec" => {
            words.windows(2).position(|pair| is_program(pair[0]) && !is_program(pair[1]))?
        }
        _ => return None,
    };
    Some(words[program + 1..].iter().map(|&word| word.to_owned()).collect())
}

/// Why the program does not understand what it is called with. A token may come from the environment.
fn refusal(arguments: &[String]) -> Option<String> {
    let with = |more: &[&str]| {
        let given =
            iter::once("avln").chain(arguments.iter().map(String::as_str)).chain(more.iter().copied());
        Cli::try_parse_from(given).err()
    };
    let mut error = with(&[])?;
    if error.kind() == ErrorKind::MissingRequiredArgument {
        error = with(&["--token", "TOKEN"])?;
    }
    let is_answer = matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion);
    (!is_answer).then(|| error.to_string())
}

/// All lines of the repository in which the program may be called, with where they stand.
fn written() -> Vec<(String, String)> {
    let mut found = Vec::new();
    let mut add = |place: String, lines: Vec<String>| {
        found.extend(lines.into_iter().map(|line| (place.clone(), line)));
    };
    let generated = root().join("docs/CLI.md");
    for page in files(&root(), ".md").into_iter().filter(|page| *page != generated) {
        add(shown(&page), typed(&fs::read_to_string(&page).expect("a text")));
    }
    for script in files(&root(), ".sh") {
        let lines = fs::read_to_string(&script).expect("a text").replace("\\\n", " ").replace("$(", "(");
        add(shown(&script), lines.lines().map(|line| line.replace("token=(", "(")).collect());
    }
    for unit in files(&root().join("packaging"), ".service") {
        let lines = fs::read_to_string(&unit).expect("a text");
        let started = lines
            .lines()
            .filter_map(|line| line.split_once("="))
            .filter(|(name, _)| name.starts_with("Exec"));
        let plain =
            started.map(|(_, line)| line.trim_start_matches("/bin/sh -c ").trim_matches('\'').to_owned());
        add(shown(&unit), plain.collect());
    }
    for image in files(&root().join("docker"), ".Dockerfile") {
        let lines = fs::read_to_string(&image).expect("a text");
        let lists = lines
            .lines()
            .filter_map(|line| line.split_once("CMD ["))
            .map(|(_, list)| list.replace([',', ']'], " "));
        add(shown(&image), lists.collect());
    }
    add("docker/compose.yaml".to_owned(), composed());
    found
}

/// The commands of the services.
fn composed() -> Vec<String> {
    let documents = YamlLoader::load_from_str(&text("docker/compose.yaml")).expect("YAML");
    let services = documents[0]["services"].as_hash().expect("services").values();
    let line = |command: &Yaml| match command {
        Yaml::Array(words) => words.iter().filter_map(Yaml::as_str).collect::<Vec<_>>().join(" "),
        other => other.as_str().unwrap_or_default().replace("${AVLN_AGENT_COMMAND:-", "").replace('}', ""),
    };
    services.map(|service| line(&service["command"])).collect()
}

#[test]
fn what_people_are_told_to_type_is_understood() {
    let mut refused = Vec::new();
    let mut places = Vec::new();
    for (place, line) in written() {
        for arguments in commands(&line).iter().filter_map(|words| arguments(words)) {
            if let Some(error) = refusal(&arguments) {
                refused.push(format!("{place}: {line}\n{error}"));
            }
            places.push(place.clone());
        }
    }
    assert!(refused.is_empty(), "{}", refused.join("\n"));
    assert!(places.len() > 60, "{} calls are found", places.len());
    let found = |place: &str| places.iter().any(|known| known == place);
    let sources =
        ["README.md", "docs/ORGANISING.md", "docker/compose.yaml", "docker/trial.sh", "docker/backup.sh"];
    for place in sources.into_iter().chain(["docker/server.Dockerfile", "packaging/avln.service"]) {
        assert!(found(place), "{place} calls the program");
    }
}

#[test]
fn a_line_of_shell_is_taken_apart() {
    let calls =
        |line: &str| -> Vec<_> { commands(line).iter().filter_map(|words| arguments(words)).collect() };
    assert_eq!(
        calls("A=1 avln challenge team add \"Ada's team\"  # once"),
        [["challenge", "team", "add", "Ada's team"]]
    );
    assert_eq!(calls("avln challenge reveal a > b.json && avln serve").len(), 2);
    assert_eq!(calls("docker compose run --rm challenge-server avln data split make val")[0].len(), 4);
    assert_eq!(calls("sudo -u avln avln data db backup x")[0][0], "data");
    assert!(calls("systemctl restart avln").is_empty());
    assert!(refusal(&["serve".into(), "--no-such-thing".into()]).is_some());
    assert!(refusal(&["team".into(), "add".into()]).is_some());
    assert!(refusal(&["admin".into(), "status".into()]).is_none());
}
