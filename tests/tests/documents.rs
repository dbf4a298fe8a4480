//! Documents and the commands in them.

/// Links resolve, files and functions stay short, no unfinished work.
mod text {
    use avln_tests::machine::{files, root, shown};
    use std::{fs, path::PathBuf};

    const MAX_FILE_LINES: usize = 500;
    const MAX_FUNCTION_LINES: usize = 70;

    fn sources() -> Vec<(PathBuf, String)> {
        let paths = files(&root(), ".rs");
        assert!(paths.len() > 100, "the sources are found: {}", paths.len());
        paths.into_iter().map(|path| (path.clone(), fs::read_to_string(&path).expect("a text"))).collect()
    }

    /// Markdown link targets in `text`, without code blocks.
    fn links(text: &str) -> Vec<String> {
        let prose: String = text.split("```").step_by(2).collect();
        let target = |rest: &str| rest.split([')', ' ', '#']).next().unwrap_or_default().to_owned();
        prose.split("](").skip(1).map(target).collect()
    }

    #[test]
    fn links_in_the_documentation_lead_to_files() {
        let pages = files(&root(), ".md");
        let mut broken = Vec::new();
        for page in &pages {
            let text = fs::read_to_string(page).expect("a text");
            let folder = page.parent().expect("a page lies in a folder");
            let relative =
                |link: &String| !link.is_empty() && !link.contains("://") && !link.starts_with("mailto:");
            let dead = |link: &String| !folder.join(link).exists();
            let dead = links(&text).into_iter().filter(relative).filter(dead);
            broken.extend(dead.map(|link| format!("{}: {link}", shown(page))));
        }
        assert!(pages.iter().any(|page| page.ends_with("docs/ARCHITECTURE.md")));
        assert_eq!(broken, Vec::<String>::new());
        assert_eq!(links("[a](b.md#c) ```[d](e)``` [f](g)"), ["b.md", "g"]);
    }

    #[test]
    fn source_files_have_at_most_500_lines() {
        let long = |(path, text): &(PathBuf, String)| {
            let lines = text.lines().count();
            (lines > MAX_FILE_LINES).then(|| format!("{}: {lines} lines", shown(path)))
        };
        assert_eq!(sources().iter().filter_map(long).collect::<Vec<_>>(), Vec::<String>::new());
    }

    /// Names and lengths of functions in text formatted by rustfmt.
    fn functions(text: &str) -> Vec<(&str, usize)> {
        let lines: Vec<&str> = text.lines().collect();
        let mut found = Vec::new();
        for (first, line) in lines.iter().enumerate() {
            let code = line.trim_start();
            let words = code.split_whitespace().take_while(|word| *word != "fn");
            let modifiers = ["pub", "pub(crate)", "pub(super)", "async", "const", "extern", "\"C\""];
            let is_function = code.split_whitespace().any(|word| word == "fn")
                && words.into_iter().all(|word| modifiers.contains(&word));
            if !is_function || code.ends_with(';') || code.ends_with('}') {
                continue;
            }
            let opens_body = lines[first..].iter().find(|line| line.ends_with(['{', ';', '}']));
            if opens_body.is_none_or(|line| line.ends_with(';')) {
                continue;
            }
            let end = format!("{}}}", &line[..line.len() - code.len()]);
            let length = lines[first..].iter().position(|line| *line == end);
            found.extend(length.map(|length| (code, length + 1)));
        }
        found
    }

    #[test]
    fn no_function_is_longer_than_a_screen() {
        let mut long = Vec::new();
        let mut count = 0;
        for (path, text) in &sources() {
            let found = functions(text);
            count += found.len();
            let too_long = found.into_iter().filter(|(_, lines)| *lines > MAX_FUNCTION_LINES);
            long.extend(too_long.map(|(name, lines)| format!("{}: {lines} lines: {name}", shown(path))));
        }
        assert!(count > 1000, "functions are found: {count}");
        assert_eq!(long, Vec::<String>::new());
        let example = "impl A {\n    pub async fn b() {\n        if c {\n        }\n    }\n    fn d();\n}";
        assert_eq!(functions(example), [("pub async fn b() {", 4)]);
    }

    #[test]
    fn nothing_is_left_half_done() {
        // Put together here, so that this file does not find itself.
        let marks = [
            ["TO", "DO"],
            ["FIX", "ME"],
            ["XX", "X"],
            ["dbg", "!("],
            ["todo", "!("],
            ["unimplemented", "!("],
        ];
        let marks = marks.map(|parts| parts.concat());
        let mut left = Vec::new();
        for (path, text) in &sources() {
            for (number, line) in text.lines().enumerate() {
                if marks.iter().any(|mark| line.contains(mark)) {
                    left.push(format!("{}:{}: {}", shown(path), number + 1, line.trim()));
                }
            }
        }
        assert_eq!(left, Vec::<String>::new());
    }
}

/// The program accepts every command line in documents, images and unit files.
mod commands {
    use avln_cli::Cli;
    use avln_tests::machine::{files, root, shown, text, typed};
    use clap::{Parser, error::ErrorKind};
    use std::{fs, iter, mem};
    use yaml_rust2::{Yaml, YamlLoader};

    /// Simple commands in a shell line, as words, without comments and redirections.
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
                    let is_stream = letter == '>' && word == "2";
                    let ended = mem::take(&mut word);
                    if mem::take(&mut is_word) && !is_stream {
                        words.push(ended);
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

    /// Arguments in a call to our program; `None` for other programs.
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

    /// Parser error for a call; tokens may come from the environment.
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

    /// Shell lines in the repository, with file and line.
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

    /// Service commands.
    fn composed() -> Vec<String> {
        let documents = YamlLoader::load_from_str(&text("docker/compose.yaml")).expect("YAML");
        let services = documents[0]["services"].as_hash().expect("services").values();
        let line = |command: &Yaml| match command {
            Yaml::Array(words) => words.iter().filter_map(Yaml::as_str).collect::<Vec<_>>().join(" "),
            other => {
                other.as_str().unwrap_or_default().replace("${AVLN_AGENT_COMMAND:-", "").replace('}', "")
            }
        };
        services.map(|service| line(&service["command"])).collect()
    }

    #[test]
    fn documented_commands_parse() {
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
}

/// Paths in the pages for contributors.
mod contributors {
    use avln_tests::machine::{root, text};

    const FOLDERS: [&str; 13] = [
        "agents/",
        "benches/",
        "cli/",
        "client-sdk/",
        "docker/",
        "docs/",
        "fuzz/",
        "lab/",
        "packaging/",
        "proto/",
        "server/",
        "tests/",
        ".ci/",
    ];
    const MAX_RECIPE_LINES: usize = 10;

    /// Paths in backticks, without placeholders.
    fn paths(page: &str) -> Vec<&str> {
        let quoted = page.split('`').skip(1).step_by(2);
        let is_path = |words: &&str| {
            FOLDERS.iter().any(|folder| words.starts_with(folder))
                && !words.contains([' ', '*', '<', '…'])
                && !words.contains("NAME")
        };
        quoted.filter(is_path).collect()
    }

    #[test]
    fn named_paths_exist() {
        let pages = [("CONTRIBUTING.md", 20), ("docs/ARCHITECTURE.md", 300), ("docs/source-files.md", 500)];
        for (page, least) in pages {
            let text = text(page);
            let paths = paths(&text);
            let missing: Vec<_> = paths.iter().filter(|path| !root().join(path).exists()).collect();
            assert!(missing.is_empty(), "{page}: {missing:?}");
            assert!(paths.len() >= least, "{page}: {} paths", paths.len());
        }
    }

    #[test]
    fn recipes_are_short() {
        let page = text("CONTRIBUTING.md");
        let (_, recipes) = page.split_once("## Recipes\n").expect("recipes");
        let (recipes, _) = recipes.split_once("\n## ").expect("a section after the recipes");
        let lines: Vec<_> =
            recipes.split("\n**").skip(1).map(|recipe| recipe.trim().lines().count()).collect();
        assert_eq!(lines.len(), 5, "{lines:?}");
        // The title and a blank line precede the recipe.
        assert!(lines.iter().all(|lines| *lines <= MAX_RECIPE_LINES + 2), "{lines:?}");
    }
}

/// Names in a release.
mod releases {
    use avln_tests::machine::text;

    #[test]
    fn binstall_finds_the_archive_of_a_release() {
        let (manifest, script) = (text("cli/Cargo.toml"), text("packaging/dist.sh"));
        let value = |text: &str, start: &str| {
            let value = text.lines().find_map(|line| line.strip_prefix(start));
            value.unwrap_or_else(|| panic!("no line starts with '{start}'")).to_owned()
        };
        let name =
            value(&script, "name=").replace("$version", "{ version }").replace("$target", "{ target }");
        let archive = format!("\"{{ repo }}/releases/download/v{{ version }}/{name}.tar.gz\"");
        assert_eq!(value(&manifest, "pkg-url = "), archive);
        assert_eq!(value(&manifest, "bin-dir = "), format!("\"{name}/avln{{ binary-ext }}\""));
        for path in ["folder=dist/$name\n", " \"$folder/avln\"\n", " >\"dist/$name.tar.gz\"\n"] {
            assert!(script.contains(path), "{path}");
        }
    }
}

/// The threat model names existing tests.
mod security {
    use avln_tests::machine::text;

    const HEAD: &str = "| party | threat | protection | test |\n|---|---|---|---|\n";

    /// Rows of the table of threats, as cells.
    fn rows(page: &str) -> Vec<Vec<&str>> {
        let (_, table) = page.split_once(HEAD).expect("the table of threats");
        let lines = table.lines().take_while(|line| line.starts_with('|'));
        lines.map(|line| line.trim_matches('|').split('|').map(str::trim).collect()).collect()
    }

    /// True if `code` contains the test `name`.
    fn has_test(code: &str, name: &str) -> bool {
        let lines: Vec<_> = code.lines().map(str::trim).collect();
        let function = format!("fn {name}(");
        let mut functions = (0..lines.len()).filter(|&line| lines[line].contains(&function));
        functions.any(|line| {
            let mut attributes = lines[..line].iter().rev().take_while(|line| line.starts_with("#["));
            attributes.any(|line| line.starts_with("#[test]") || line.starts_with("#[tokio::test"))
        })
    }

    #[test]
    fn every_threat_has_an_existing_test() {
        let page = text("docs/SECURITY.md");
        let rows = rows(&page);
        assert!(rows.len() > 30, "{} threats", rows.len());
        for row in rows {
            let [_, threat, protection, test] = row[..] else { panic!("a row has four cells: {row:?}") };
            assert!(!threat.is_empty() && !protection.is_empty(), "{row:?}");
            let (file, name) = test.trim_matches('`').split_once("::").expect("a file and a test");
            assert!(has_test(&text(file), name), "{threat}: there is no test {test}");
        }
        assert!(has_test("#[tokio::test]\nasync fn a() {}", "a") && !has_test("fn a() {}", "a"));
    }

    #[test]
    fn reports_go_to_this_repository() {
        let manifest = text("Cargo.toml");
        let repository = manifest.lines().find_map(|line| line.strip_prefix("repository = \""));
        let repository = repository.expect("an address").trim_end_matches('"');
        assert!(text("docs/SECURITY.md").contains(&format!("({repository}/security/advisories/new)")));
    }
}

/// The table in source-files.md.
mod source_files {
    use avln_tests::machine::{files, root, shown, text};
    use std::path::Path;

    const PAGE: &str = "docs/source-files.md";
    const HEAD: &str = "| file | content |\n|---|---|\n";
    /// Folders with sources, outermost first.
    const FOLDERS: [&str; 9] =
        ["docs", "cli", "lab", "server", "proto", "client-sdk", "agents", "fuzz/targets", "tests/src"];

    fn is_source(path: &str) -> bool {
        let is_test = path.ends_with("tests.rs") || path.contains("/tests/") || path.contains("/benches/");
        let is_script = path.ends_with("/build.rs") && !path.contains("/src/");
        let is_made = is_script || path.contains("/v1/") && path.ends_with(".py");
        !is_test && !is_made
    }

    /// First sentence of a file's documentation.
    fn purpose(text: &str) -> String {
        let marks = ["//! ", "/// ", "// ", "\"\"\""];
        let mark_of = |line: &str| marks.into_iter().find(|mark| line.trim_start().starts_with(mark));
        let mut lines = text.lines().skip_while(|line| mark_of(line).is_none()).peekable();
        let mark = lines.peek().and_then(|line| mark_of(line)).unwrap_or_default();
        let words = |line: &str| line.trim().trim_start_matches(mark.trim_end()).trim().to_owned();
        let is_part = |line: &&str| mark == "\"\"\"" || line.trim_start().starts_with(mark.trim_end());
        let paragraph: Vec<_> =
            lines.take_while(is_part).map(words).take_while(|words| !words.is_empty()).collect();
        let paragraph = paragraph.join(" ");
        let sentence = paragraph.split(". ").next().unwrap_or_default().split("\"\"\"").next();
        sentence.unwrap_or_default().trim_end_matches('.').replace('|', "\\|")
    }

    fn rows() -> Vec<String> {
        let mut rows = Vec::new();
        for folder in FOLDERS {
            let endings = [".rs", ".py", ".proto", ".js", ".mjs"];
            let mut paths: Vec<_> = endings
                .iter()
                .flat_map(|ending| files(&root().join(folder), ending))
                .map(|path| shown(&path))
                .collect();
            paths.sort();
            for path in paths.into_iter().filter(|path| is_source(path)) {
                let row = format!("| `{path}` | {} |\n", purpose(&text(Path::new(&path))));
                if !rows.contains(&row) {
                    rows.push(row);
                }
            }
        }
        rows
    }

    #[test]
    fn purpose_is_the_first_sentence() {
        assert_eq!(purpose("//! Ids and\n//! tokens. More.\n"), "Ids and tokens");
        assert_eq!(purpose("use std::fs;\n\n/// A `path`.\nfn a() {}\n"), "A `path`");
        assert_eq!(purpose("\"\"\"Errors.\"\"\"\n\nimport os\n"), "Errors");
        assert_eq!(purpose(""), "");
    }

    #[test]
    fn page_lists_every_source_file() {
        let page = text(PAGE);
        let (before, rest) = page.split_once(HEAD).expect("the table of source files");
        let after = rest.lines().skip_while(|line| line.starts_with('|')).collect::<Vec<_>>().join("\n");
        let rows = rows();
        assert!(rows.len() > 300, "{}", rows.len());
        let unexplained: Vec<_> = rows.iter().filter(|row| row.ends_with("|  |\n")).collect();
        assert!(unexplained.is_empty(), "files without documentation: {unexplained:?}");
        let expected = format!("{before}{HEAD}{}{after}\n", rows.concat());
        if std::env::var_os("AVLN_BLESS").is_some() {
            std::fs::write(root().join(PAGE), &expected).expect("the page can be written");
        }
        let hint = "run AVLN_BLESS=1 cargo test -p avln-tests documents";
        assert!(text(PAGE) == expected, "the table of source files is out of date; {hint}");
    }
}
