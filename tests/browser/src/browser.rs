//! A browser that is driven.

use crate::Problem;
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use thirtyfour::{By, ChromiumLikeCapabilities, DesiredCapabilities, WebDriver, WebElement};
use tokio::runtime::{Builder, Runtime};

/// A running `chromedriver`.
pub struct Driver {
    process: Child,
    port: u16,
}

impl Driver {
    /// Starts it on a port of its choice.
    ///
    /// # Errors
    /// It is not there, or does not say its port.
    pub fn start() -> Result<Self, Problem> {
        let mut process = Command::new("chromedriver")
            .arg("--port=0")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .map_err(|error| format!("chromedriver: {error}"))?;
        let output = process.stdout.take().ok_or("chromedriver has no output")?;
        let port = BufReader::new(output)
            .lines()
            .map_while(Result::ok)
            .find_map(|line| {
                let (_, port) = line.split_once("started successfully on port ")?;
                port.trim_end_matches('.').parse().ok()
            });
        match port {
            Some(port) => Ok(Self { process, port }),
            None => {
                let _ = process.kill();
                let _ = process.wait();
                Err("chromedriver did not say on which port it is".into())
            }
        }
    }
}

impl Drop for Driver {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// A window with a page.
pub struct Browser {
    runtime: Runtime,
    window: Option<WebDriver>,
    name: String,
    pictures: PathBuf,
}

impl Browser {
    /// Opens a page without a screen; if a test `name` fails, a picture of it is kept in the folder
    /// `pictures`.
    ///
    /// # Errors
    /// There is no Chromium, or it does not open the page.
    pub fn open(driver: &Driver, page: &Path, name: &str, pictures: &Path) -> Result<Self, Problem> {
        let url = format!("file://{}", std::path::absolute(page)?.display());
        Self::visit(driver, &url, name, pictures)
    }

    /// [`Self::open`] of an address.
    ///
    /// # Errors
    /// There is no Chromium, or it does not open the page.
    pub fn visit(driver: &Driver, address: &str, name: &str, pictures: &Path) -> Result<Self, Problem> {
        let runtime = Builder::new_current_thread().enable_all().build()?;
        let mut wanted = DesiredCapabilities::chrome();
        // Only a page of our own is opened, and containers have no other sandbox inside them.
        for argument in [
            "--headless=new",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-dev-shm-usage",
            "--window-size=1400,1000",
        ] {
            wanted.add_arg(argument)?;
        }
        let url = format!("http://127.0.0.1:{}", driver.port);
        let window = runtime.block_on(WebDriver::new(url, wanted))?;
        let browser = Self {
            runtime,
            window: Some(window),
            name: name.to_owned(),
            pictures: pictures.to_owned(),
        };
        browser.runtime.block_on(browser.window()?.goto(address))?;
        Ok(browser)
    }

    fn window(&self) -> Result<&WebDriver, Problem> {
        self.window.as_ref().ok_or_else(|| "the window is closed".into())
    }

    /// What a function of JavaScript returns.
    ///
    /// # Errors
    /// It throws.
    pub fn run(&self, body: &str) -> Result<Value, Problem> {
        let answer = self.runtime.block_on(self.window()?.execute(body, Vec::new()))?;
        Ok(answer.json().clone())
    }

    /// Waits until an expression of JavaScript is true.
    ///
    /// # Errors
    /// It is not within ten seconds.
    pub fn wait(&self, expression: &str) -> Result<(), Problem> {
        for _ in 0..200 {
            if self.run(&format!("return Boolean({expression})"))? == true {
                return Ok(());
            }
            std::thread::sleep(std::time::Duration::from_millis(50));
        }
        Err(format!("never true: {expression}").into())
    }

    /// The text of an element as it is shown.
    ///
    /// # Errors
    /// There is none.
    pub fn text(&self, selector: &str) -> Result<String, Problem> {
        let element = self.find(selector)?;
        Ok(self.runtime.block_on(element.text())?)
    }

    /// Types into an element, which gets the focus by it. Keys that are no letters are those of
    /// [`thirtyfour::Key`].
    ///
    /// # Errors
    /// There is none, or it takes no keys.
    pub fn keys(&self, selector: &str, keys: &str) -> Result<(), Problem> {
        let element = self.find(selector)?;
        Ok(self.runtime.block_on(element.send_keys(keys))?)
    }

    /// Types to what has the focus.
    ///
    /// # Errors
    /// The browser does not answer.
    pub fn type_keys(&self, keys: &str) -> Result<(), Problem> {
        Ok(self
            .runtime
            .block_on(self.window()?.action_chain().send_keys(keys).perform())?)
    }

    /// Clicks on an element.
    ///
    /// # Errors
    /// There is none, or it cannot be clicked.
    pub fn click(&self, selector: &str) -> Result<(), Problem> {
        let element = self.find(selector)?;
        Ok(self.runtime.block_on(element.click())?)
    }

    /// Moves the pointer over an element, so far from its middle in pixels of the page.
    ///
    /// # Errors
    /// There is none.
    pub fn point(&self, selector: &str, [x, y]: [i64; 2]) -> Result<(), Problem> {
        let element = self.find(selector)?;
        let chain = self.window()?.action_chain();
        Ok(self
            .runtime
            .block_on(chain.move_to_element_with_offset(&element, x, y).perform())?)
    }

    /// Presses the pointer in the middle of an element, moves it in steps of this size, and
    /// releases it.
    ///
    /// # Errors
    /// There is none.
    pub fn drag(&self, selector: &str, [x, y]: [i64; 2], steps: usize) -> Result<(), Problem> {
        let element = self.find(selector)?;
        let mut chain = self
            .window()?
            .action_chain()
            .move_to_element_center(&element)
            .click_and_hold();
        for _ in 0..steps {
            chain = chain.move_by_offset(x, y);
        }
        Ok(self.runtime.block_on(chain.release().perform())?)
    }

    fn find(&self, selector: &str) -> Result<WebElement, Problem> {
        let found = self.runtime.block_on(self.window()?.find(By::Css(selector)));
        found.map_err(|error| format!("{selector}: {error}").into())
    }

    /// Ends a test: closes the window, after it has been pictured if the test failed.
    ///
    /// # Errors
    /// What the test found, with the place of the picture.
    pub fn close(mut self, found: Result<(), Problem>) -> Result<(), Problem> {
        let Some(window) = self.window.take() else {
            return found;
        };
        let found = found.map_err(|problem| {
            let path = self.pictures.join(format!("{}.png", self.name));
            let kept = std::fs::create_dir_all(&self.pictures).is_ok()
                && self.runtime.block_on(window.screenshot(&path)).is_ok();
            match kept {
                true => format!("{problem}\nscreenshot: {}", path.display()).into(),
                false => problem,
            }
        });
        let closed = self.runtime.block_on(window.quit());
        found?;
        Ok(closed?)
    }
}
