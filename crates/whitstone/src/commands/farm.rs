//! Descriptions of the jobs of a file for other programs: make, Slurm, and render farms that read
//! Open Job Description. Each only calls `run-job` and `merge`.

use crate::jobs::Job;
use crate::terminal::Failure;
use serde_json::json;
use std::path::{Path, PathBuf};
use whitstone_validate::quoted;

/// A file of jobs, and what becomes of them.
pub(super) struct Farm<'a> {
    /// The name of the program on the machines that run it.
    pub(super) program: &'a str,
    pub(super) jobs: &'a Path,
    pub(super) results: &'a Path,
    /// Number of jobs.
    pub(super) count: usize,
    /// The image, or the folder of the images.
    pub(super) merged: PathBuf,
}

/// Number of tasks of an array job: Slurm's default limit is 1001.
const MAX_ARRAY: usize = 1000;

impl Farm<'_> {
    /// The absolute paths of jobs, results and images: a task may run in another folder.
    fn paths(&self) -> Result<[String; 3], Failure> {
        let mut paths = [self.jobs, self.results, &self.merged].map(|path| (path, String::new()));
        for (path, text) in &mut paths {
            let whole = std::path::absolute(&path).map_err(Failure::usage)?;
            let known = whole
                .to_str()
                .ok_or_else(|| Failure::usage(format!("{}: the name is not valid UTF-8", path.display())))?;
            *text = known.to_owned();
        }
        Ok(paths.map(|(_, text)| text))
    }

    /// A Makefile.
    pub(super) fn make(&self, jobs: &[Job]) -> Result<String, Failure> {
        let paths = self.paths()?;
        // In a Makefile, some characters cannot be part of the name of a file.
        let is_plain = |c: char| c.is_alphanumeric() || "/._-+@,".contains(c);
        if let Some(path) = paths.iter().find(|path| !path.chars().all(is_plain)) {
            return Err(Failure::usage(format!(
                "{path}: make cannot name this file; expected letters, digits and any of / . _ - + @ ,"
            )));
        }
        let [file, results, merged] = paths;
        let targets: String = jobs
            .iter()
            .map(|job| format!(" \\\n  {results}/{}", job.outputs[1]))
            .collect();
        Ok(format!(
            "# Written by `{program} plan`. A job is run again only if it has no result.\n\
             WHITSTONE ?= {program}\n\
             .PHONY: all\n\
             all:{targets}\n\
             \t$(WHITSTONE) merge {file} --results {results} -o {merged}\n\
             {results}/%.json:\n\
             \t$(WHITSTONE) run-job {file} --id $* --results {results} --threads 1\n",
            program = self.program,
        ))
    }

    /// A script for `sbatch`.
    pub(super) fn slurm(&self) -> Result<String, Failure> {
        let [file, results, merged] = self.paths()?.map(|path| quoted(&path));
        let (program, count) = (self.program, self.count);
        let tasks = count.min(MAX_ARRAY);
        let last = tasks - 1;
        Ok(format!(
            "#!/bin/sh\n\
             #SBATCH --job-name=whitstone\n\
             #SBATCH --array=0-{last}\n\
             # Written by `{program} plan`. When all tasks have ended:\n\
             #   {program} merge {file} --results {results} -o {merged}\n\
             status=0\n\
             index=$SLURM_ARRAY_TASK_ID\n\
             while [ \"$index\" -lt {count} ]; do\n  \
               {program} run-job {file} --index \"$index\" --results {results} \\\n    \
                 --threads \"${{SLURM_CPUS_PER_TASK:-1}}\" || status=$?\n  \
               index=$((index + {tasks}))\n\
             done\n\
             exit \"$status\"\n"
        ))
    }

    /// A job template of Open Job Description (2023-09).
    pub(super) fn openjd(&self) -> Result<String, Failure> {
        let [file, results, merged] = self.paths()?;
        let command = |arguments: serde_json::Value| json!({ "actions": { "onRun": { "command": self.program, "args": arguments } } });
        let template = json!({
            "specificationVersion": "jobtemplate-2023-09",
            "name": "whitstone",
            "steps": [
                {
                    "name": "tiles",
                    "parameterSpace": { "taskParameterDefinitions": [
                        { "name": "Index", "type": "INT", "range": format!("0-{}", self.count - 1) },
                    ] },
                    "script": command(json!([
                        "run-job", file, "--index", "{{Task.Param.Index}}", "--results", results,
                    ])),
                },
                {
                    "name": "merge",
                    "dependencies": [{ "dependsOn": "tiles" }],
                    "script": command(json!(["merge", file, "--results", results, "-o", merged])),
                },
            ],
        });
        Ok(format!("{template:#}\n"))
    }
}
